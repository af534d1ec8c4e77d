"""Torques, mass matrices and gravity: against Pinocchio, closed forms, published constants, and physics itself."""

from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import optik
from optik import Inertia, JointLimits, Robot, dynamics
from optik.errors import InvalidInput
from tests import oracles

HEAVY = [name for name in optik.robots() if optik.load(name).inertia is not None]
PAYLOADS: dict[str, dict[str, Any]] = {
    "none": {"mass": None},
    "point": {"mass": 3.0},
    "body": {"mass": 2.0, "com": (0.02, -0.05, 0.1), "inertia": np.diag([0.02, 0.03, 0.015])},
}
seeds = st.integers(0, 2**32 - 1)


def tensors(rng: np.random.Generator, mass: Any) -> Any:
    """Inertias of clouds of points: what bodies can have."""
    points = rng.normal(size=(len(mass), 5, 3)) * 0.1
    square = (points**2).sum(-1)[..., None, None] * np.eye(3) - points[..., :, None] * points[..., None, :]
    return mass[:, None, None] * square.mean(1)


@cache
def random_robot(seed: int) -> Robot:
    """An arm of any joints and masses, without friction, on its side; some links have no mass."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 8))
    T = [oracles.pose(*rng.normal(size=(2, 3))) for _ in range(n + 1)]
    mass = rng.uniform(0.1, 5.0, n) * (rng.random(n) < 0.8)
    mass[-1] = 1.0
    heavy = (mass > 0.0)[:, None]
    inertia = Inertia(mass, rng.normal(size=(n, 3)) * 0.1 * heavy, tensors(rng, mass), motor=rng.uniform(0.0, 0.3, n))
    limits = JointLimits(np.full(n, -2.0), np.full(n, 2.0))
    return Robot("any", T[:n], rng.random(n) < 0.3, T[n], limits, gravity=rng.normal(size=3), inertia=inertia)


def states(robot: Robot, count: int, seed: int = 0) -> Any:
    rng = np.random.default_rng(seed)
    return robot.limits.sample(rng, count), *(rng.normal(size=(2, count, robot.n)) * [[[2.0]], [[10.0]]])


# ---------------------------------------------------------------- against Pinocchio
@pytest.mark.parametrize("payload", PAYLOADS.values(), ids=PAYLOADS.keys())
@pytest.mark.parametrize("name", HEAVY)
def test_torques_and_mass_matrices_are_pinocchios(name: str, payload: dict[str, Any]) -> None:
    robot = optik.load(name).with_payload(**payload)
    other = oracles.PinocchioDynamics(robot)
    q, dq, ddq = states(robot, 1000)
    torques, matrices, gravity = robot.torques(q, dq, ddq), robot.mass_matrix(q), robot.gravity_torques(q)
    for i in range(1000):
        expected, M = other.torques(q[i], dq[i], ddq[i]), other.mass_matrix(q[i])
        assert np.abs(torques[i] - expected).max() <= 1e-12 * np.abs(expected).max()
        assert np.abs(matrices[i] - M).max() <= 1e-12 * np.abs(M).max()
        assert np.abs(gravity[i] - other.gravity(q[i])).max() <= 1e-12 * np.abs(expected).max()


@given(seeds)
def test_any_arm_is_pinocchios_sliding_joints_and_links_without_mass_too(seed: int) -> None:
    robot = random_robot(seed % 20).with_payload(1.5, (0.1, 0.2, -0.1)).with_inertia(viscous=0.4, coulomb=0.7)
    q, dq, ddq = (part[0] for part in states(robot, 1, seed))
    other = oracles.PinocchioDynamics(robot)
    expected, M = other.torques(q, dq, ddq), other.mass_matrix(q)
    assert np.abs(robot.torques(q, dq, ddq) - expected).max() <= 1e-12 * np.abs(expected).max()
    assert np.abs(robot.mass_matrix(q) - M).max() <= 1e-12 * np.abs(M).max()


def test_the_recursion_with_rates_has_the_same_torques_and_their_derivatives() -> None:
    for seed in range(20):
        robot = random_robot(seed)
        rng = np.random.default_rng(seed)
        state = rng.normal(size=(4, robot.n))
        bodies, work, out = robot.loads[0].bodies, np.empty((8, robot.n + 1, 4, 4)), np.empty((2, robot.n))
        dynamics.rigid_torques(robot.chain, bodies, 1.0, state, work, out)

        def torques(t: float, robot: Robot = robot, state: Any = state) -> Any:
            q, v, a, j = state
            return robot.torques(q + t * (v + t * (a / 2 + t * j / 6)), v + t * (a + t * j / 2), a + t * j)

        rate = (8 * (torques(1e-3) - torques(-1e-3)) - (torques(2e-3) - torques(-2e-3))) / 12e-3
        scale = np.abs(out[0]).max()
        assert np.abs(out[0] - torques(0.0)).max() <= 1e-13 * scale
        assert np.abs(out[1] - rate).max() <= 1e-8 * max(scale, np.abs(out[1]).max())


# ---------------------------------------------------------------- closed forms and published constants
def test_a_pendulum_on_a_slide_is_the_textbooks() -> None:
    limits = JointLimits([-1.0, -3.0], [1.0, 3.0])
    turn = oracles.rot_x(np.pi / 2)  # the pendulum turns in the x–z plane of the base, the cart slides along x
    along = np.array([[0.0, 0.0, 1.0, 0.0], [0.0, 1.0, 0.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
    masses = Inertia([5.0, 2.0], [[0.0] * 3, [0.4, 0.0, 0.0]], [np.zeros((3, 3)), np.diag([0.0, 0.3, 0.3])])
    cart = Robot("cart", [along, np.linalg.inv(along) @ turn], [True, False], np.eye(4), limits, inertia=masses)
    q, w, dv, a = 0.7, 1.3, 0.9, -2.1
    force, torque = cart.torques([0.2, q], [0.5, w], [dv, a])
    assert force == pytest.approx(7.0 * dv + 0.8 * (-np.sin(q) * a - np.cos(q) * w**2), rel=1e-14)
    assert torque == pytest.approx(0.62 * a - 0.8 * np.sin(q) * dv + 0.8 * 9.80665 * np.cos(q), rel=1e-14)


@pytest.mark.parametrize("name", ["paper6r", "puma560"])
def test_friction_is_its_closed_form_and_none_at_rest(name: str) -> None:
    robot = optik.load(name)
    q, dq, ddq = states(robot, 50)
    dq[::2, 1] = 0.0
    smooth = robot.with_inertia(viscous=0.0, coulomb=0.0)
    friction = robot.torques(q, dq, ddq) - smooth.torques(q, dq, ddq)
    expected = robot.inertia.viscous * dq + robot.inertia.coulomb * np.sign(dq)
    assert np.abs(friction - expected).max() < 1e-12
    assert (expected[::2, 1] == 0.0).all()
    assert (np.abs(expected) > 0.1).any(axis=0).all()


def test_gravity_torques_of_the_puma_are_those_of_the_published_constants() -> None:
    """Armstrong, Khatib and Burdick 1986: constants g1 … g5 with their tolerances [N·m]; their arm is turned by π."""
    robot = optik.load("puma560")
    q = robot.limits.sample(np.random.default_rng(3), 400)
    _, two, three, four, five, _ = (q + np.pi * np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])).T
    s23, c23 = np.sin(two + three), np.cos(two + three)
    s4, c4, s5, c5 = np.sin(four), np.cos(four), np.sin(five), np.cos(five)
    zero, wrist = np.zeros(400), s23 * c5 + c23 * c4 * s5
    columns = [  # of g1 … g5, for joints 2 to 5
        [np.cos(two), s23, np.sin(two), c23, wrist],
        [zero, s23, zero, c23, wrist],
        [zero, zero, zero, zero, -s23 * s4 * s5],
        [zero, zero, zero, zero, c23 * s5 + s23 * c4 * c5],
    ]
    torques = robot.gravity_torques(q)
    assert np.abs(torques[:, [0, 5]]).max() < 1e-12
    A = np.concatenate([np.array(joint).T for joint in columns])
    found, *_ = np.linalg.lstsq(A, torques[:, 1:5].T.ravel(), rcond=None)
    assert np.abs(A @ found - torques[:, 1:5].T.ravel()).max() < 1e-12  # of this form exactly
    published, tolerance = [-37.2, -8.44, 1.02, 0.249, -0.0282], [0.5, 0.20, 0.50, 0.025, 0.0056]
    assert (np.abs(found - published) < tolerance).all()
    assert np.abs(found / published - 1.0).max() < 0.005


@pytest.mark.soak
@pytest.mark.filterwarnings("ignore")
def test_the_puma_is_the_robotics_toolboxs_but_for_the_sign_of_one_centre_of_mass() -> None:
    from roboticstoolbox.models.DH import Puma560

    other, robot = Puma560(), optik.load("puma560").with_gravity(magnitude=9.81).with_inertia(coulomb=0.0)
    other.links[3].r = [0.0, -0.019, 0.0]
    other = other.nofriction(coulomb=True, viscous=False)
    q, dq, ddq = states(robot, 50)
    for i in range(50):
        expected = other.rne(q[i], dq[i], ddq[i], gravity=[0.0, 0.0, -9.81])
        assert np.abs(robot.torques(q[i], dq[i], ddq[i]) - expected).max() <= 1e-8 * np.abs(expected).max()
        assert np.abs(robot.mass_matrix(q[i]) - other.inertia(q[i])).max() < 1e-8


# ---------------------------------------------------------------- physics
@given(seeds)
def test_a_mass_matrix_is_symmetric_and_positive_definite_and_gives_the_torques(seed: int) -> None:
    robot = random_robot(seed % 20).with_payload(0.5)
    q, dq, ddq = (part[0] for part in states(robot, 1, seed))
    M = robot.mass_matrix(q)
    assert (M == M.T).all()
    assert np.linalg.eigvalsh(M)[0] > 0.0
    bias, zero = robot.torques(q, dq, np.zeros(robot.n)), np.zeros(robot.n)
    torques = robot.torques(q, dq, ddq)
    assert np.abs(M @ ddq + bias - torques).max() <= 1e-12 * max(np.abs(torques).max(), np.abs(bias).max())
    gravity = robot.gravity_torques(q)
    coriolis = bias - gravity
    assert np.abs(robot.torques(q, 2.0 * dq, zero) - gravity - 4.0 * coriolis).max() <= 1e-11 * np.abs(bias).max()


@given(seeds)
def test_power_is_the_change_of_energy(seed: int) -> None:
    robot = random_robot(seed % 20)
    q, dq, ddq = (part[0] for part in states(robot, 1, seed))
    heaviness = robot.gravity_magnitude * robot.gravity

    def energy(t: float) -> float:
        at, v = q + t * (dq + t * ddq / 2), dq + t * ddq
        frames = robot.frames(at)[:-1]
        places = frames[:, :3, 3] + np.einsum("irc,ic->ir", frames[:, :3, :3], robot.inertia.com)
        return float(v @ robot.mass_matrix(at) @ v / 2 - robot.inertia.mass @ places @ heaviness)

    power = (8 * (energy(1e-3) - energy(-1e-3)) - (energy(2e-3) - energy(-2e-3))) / 12e-3
    torques = robot.torques(q, dq, ddq)
    assert abs(torques @ dq - power) <= 1e-7 * (np.abs(torques * dq).sum() + 1.0)


def test_gravity_keeps_its_direction_when_the_arm_is_mounted_elsewhere() -> None:
    robot, q = optik.load("ur5e").with_payload(2.0), np.full(6, 0.4)
    moved = robot.with_base(oracles.pose((0.3, 1.0, -0.5), (1.0, 2.0, 3.0)))
    assert np.abs(moved.gravity_torques(q) - robot.gravity_torques(q)).max() < 1e-12
    hanging = robot.with_gravity([0.0, 0.0, 3.0])
    assert np.abs(hanging.gravity_torques(q) + robot.gravity_torques(q)).max() < 1e-12
    assert (robot.with_gravity(magnitude=0.0).gravity_torques(q) == 0.0).all()
    light = robot.with_gravity(magnitude=1.62)
    assert np.abs(light.gravity_torques(q) * 9.80665 / 1.62 - robot.gravity_torques(q)).max() < 1e-12


def test_a_payload_moves_with_the_tool_and_a_point_is_where_it_is_said_to_be() -> None:
    robot = optik.load("panda")
    q, dq, ddq = (part[0] for part in states(robot, 1))
    carried = robot.with_payload(3.0)
    longer = carried.with_tool(oracles.trans(z=0.2), add=True)
    same = robot.with_payload(3.0, com=(0.0, 0.0, 0.2))
    assert np.abs(longer.torques(q, dq, ddq) - same.torques(q, dq, ddq)).max() < 1e-12
    force = np.concatenate([3.0 * 9.80665 * -robot.gravity, np.zeros(3)])
    held = carried.gravity_torques(q) - robot.gravity_torques(q)
    assert np.abs(held - robot.jacobian(q).T @ force).max() < 1e-12


def test_torques_are_affine_in_the_payloads_mass_so_the_ends_of_an_interval_are_the_worst() -> None:
    robot = optik.load("panda")
    q, dq, ddq = states(robot, 20)
    com, tensor = (0.05, 0.0, 0.1), np.diag([0.02, 0.03, 0.015])
    light, middle, heavy = (
        robot.with_payload(mass, com, tensor * mass / 4.0).torques(q, dq, ddq) for mass in (1.0, 2.5, 4.0)
    )
    assert np.abs(0.5 * (light + heavy) - middle).max() <= 1e-13 * np.abs(heavy).max()


# ---------------------------------------------------------------- shapes, and what is refused
def test_configurations_broadcast_as_everywhere() -> None:
    robot = optik.load("iiwa14")
    q, dq, ddq = states(robot, 6)
    whole = robot.torques(q, dq, ddq)
    assert whole.shape == (6, 7)
    assert (whole[2] == robot.torques(q[2], dq[2], ddq[2])).all()
    assert (
        robot.torques(q.reshape(2, 3, 7), dq.reshape(2, 3, 7), ddq.reshape(2, 3, 7)) == whole.reshape(2, 3, 7)
    ).all()
    assert (robot.torques(q[0], dq, ddq[1])[4] == robot.torques(q[0], dq[4], ddq[1])).all()
    assert robot.mass_matrix(q.reshape(2, 3, 7)).shape == (2, 3, 7, 7)
    assert (robot.mass_matrix(q)[3] == robot.mass_matrix(q[3])).all()
    assert (robot.gravity_torques(q)[3] == robot.gravity_torques(q[3])).all()
    assert robot.torques(q[:0], dq[:0], ddq[:0]).shape == (0, 7)


REFUSED: dict[str, tuple[Any, str]] = {
    "masses that are unknown": (lambda r, q: optik.load("kr6").torques(q, q, q), "robot: .*masses.*'kr6'"),
    "a mass matrix of unknown masses": (lambda r, q: optik.load("kr6").mass_matrix(q), "robot: .*masses.*'kr6'"),
    "a payload of any mass": (lambda r, q: r.with_payload((0, 3)).torques(q, q, q), r"with_payload\(3\)\.torques"),
    "a matrix of any mass": (lambda r, q: r.with_payload((0, 3)).mass_matrix(q), r"with_payload\(3\)\.mass_matrix"),
    "too few joints": (lambda r, q: r.torques(q, q[:5], q), "dq: .*6"),
    "NaN": (lambda r, q: r.torques(q, q, q * np.nan), "ddq: .*NaN"),
    "shapes that do not match": (
        lambda r, q: r.torques(np.ones((2, 6)), np.ones((3, 6)), q),
        "q, dq, ddq: .*broadcast",
    ),
}


@pytest.mark.parametrize(("use", "word"), REFUSED.values(), ids=REFUSED.keys())
def test_what_has_no_torques_is_refused_by_name(use: Any, word: str) -> None:
    with pytest.raises(InvalidInput, match=word) as caught:
        use(optik.load("ur5e"), np.zeros(6))
    assert "\n" not in str(caught.value)
