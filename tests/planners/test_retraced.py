"""Paths that pass their own positions again: pick cycles, several turns of a joint, and motions that cover them in part."""

from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import PPoly

import optik
import planners
from optik import Robot, se3
from optik.arm.limits import JointLimits
from optik.errors import InvalidInput
from optik.types import Array
from planners import JointLine, Motion, MotionLimits, Plan, PointToPoint, Polyline, Trajectory, certify, plan
from planners.certificate import path_error as path_errors
from planners.certificate.path_error import ComparedInstants, joint_intervals
from planners.files.base import from_plain, to_plain
from tests import oracles

LIMITS = MotionLimits(2.0, 5.0, 50.0)
HOME = np.array([0.0, -1.5, 1.4, -1.5, -1.57, 0.0])
ABOVE = np.array([-0.364, -1.763, 1.882, -1.717, -1.56, -0.364])
PICK = np.array([-0.364, -1.717, 2.055, -1.935, -1.56, -0.364])
TOLERANCE = (1e-5, 1e-5)


@cache
def cycle(law: str, *names: str) -> Plan:
    robot = optik.load("ur5e")
    q = [{"home": HOME, "above": ABOVE, "pick": PICK}[name] for name in names]
    limits = MotionLimits(2.0, 5.0) if law == "toppra" else LIMITS
    return plan(robot, PointToPoint(robot, *q), q[0], limits=limits, timing=law)


def unlabelled(made: Plan) -> Trajectory:
    """The motion as a file has it: without the path parameters of its law."""
    return Trajectory(PPoly(made.trajectory.coefficients, made.trajectory.knots))


CYCLES = (
    ("home", "above", "pick", "above", "home"),
    ("home", "pick", "home"),
    ("home", "pick", "home", "pick", "home", "pick", "home"),
)


@pytest.mark.parametrize("names", CYCLES)
@pytest.mark.parametrize("law", ["optimal", "smooth", "ruckig", "toppra"])
def test_a_cycle_that_returns_the_same_way_is_valid(law: str, names: tuple[str, ...]) -> None:
    made = cycle(law, *names)
    assert made, made.failure
    again = certify(
        made.robot, made.path, unlabelled(made), made.limits, enforced=made.certificate.enforced, tolerance=TOLERANCE
    )
    assert again.reasons == ()
    assert again.coverage.end == made.path.end


def test_a_motion_that_makes_fewer_turns_than_its_path_is_refused() -> None:
    once, twice = cycle("ruckig", "home", "pick", "home"), cycle("ruckig", *CYCLES[2])
    alone = certify(once.robot, twice.path, unlabelled(once), LIMITS, tolerance=TOLERANCE)
    assert not alone.is_valid
    # also if its law claims the positions of the whole path
    claimed = Trajectory(
        PPoly(once.trajectory.coefficients, once.trajectory.knots),
        np.linspace(0.0, twice.path.end, once.trajectory.knots.size),
    )
    assert not certify(once.robot, twice.path, claimed, LIMITS, tolerance=TOLERANCE).is_valid


def test_a_motion_there_and_back_does_not_cover_a_path_there() -> None:
    made = cycle("smooth", "home", "pick", "home")
    there = JointLine(made.robot, HOME, PICK)
    s = np.minimum(made.trajectory.s, there.end)  # type: ignore[call-overload]
    for motion in (unlabelled(made), Trajectory(PPoly(made.trajectory.coefficients, made.trajectory.knots), s)):
        words = certify(made.robot, there, motion, LIMITS, tolerance=TOLERANCE).reasons
        assert any("the motion ends at s = " in word and "not at 0.964589" in word for word in words)


# ---------------------------------------------------------------- a joint that turns many times
def spinning() -> Robot:
    """One joint without limits, with a tool beside its axis."""
    return Robot(
        "spinning",
        oracles.trans(x=0.3)[None],
        np.zeros(1, bool),
        oracles.trans(x=0.3),
        JointLimits([-np.inf], [np.inf]),
    )


@pytest.mark.parametrize("size", [0.5, 1.0, 100.0, 7000.0, 51002.0])
def test_many_turns_of_a_joint_are_valid_and_as_fast_as_the_closed_form(size: float) -> None:
    robot = spinning()
    line = JointLine(robot, [0.3], [0.3 + size])
    shortest = float(oracles.double_s(size, *(np.array(x) for x in (2.0, 5.0, 50.0))))
    ruckig, optimal = (plan(robot, line, [0.3], limits=LIMITS, timing=law) for law in ("ruckig", "optimal"))
    assert ruckig, ruckig.failure
    assert optimal, optimal.failure
    assert ruckig.trajectory.duration == pytest.approx(shortest, rel=1e-7)
    assert optimal.trajectory.duration == pytest.approx(shortest, rel=1e-3)
    again = certify(robot, line, unlabelled(ruckig), LIMITS, tolerance=TOLERANCE)
    assert again.reasons == ()


def test_a_turn_too_few_is_refused() -> None:
    robot = spinning()
    made = plan(robot, JointLine(robot, [0.3], [0.3 + 98.0 * np.pi]), [0.3], limits=LIMITS)
    assert not certify(
        robot, JointLine(robot, [0.3], [0.3 + 100.0 * np.pi]), unlabelled(made), LIMITS, tolerance=TOLERANCE
    ).is_valid


# ---------------------------------------------------------------- the bound from the joints, where its remainder is large
def one_joint_off(joint: int, size: float) -> tuple[JointLine, Trajectory, Any]:
    """A line, a motion that is on it at both ends, at rest, and u(t) along it; between, one joint is off by 16 u² (1 − u)²."""
    line, h = JointLine(optik.load("ur5e"), HOME, HOME + 0.4), 1.5
    along = np.polynomial.Polynomial([0.0, 0.0, 3.0 / h**2, -2.0 / h**3])
    away = size * 16.0 * np.polynomial.Polynomial([0.0, 0.0, 1.0 / h**2, -2.0 / h**3, 1.0 / h**4])
    c = np.zeros((6, 1, 6))
    for j in range(6):
        p = 0.4 * along + (away if j == joint else 0.0)
        c[5 - np.arange(len(p.coef)), 0, j] = p.coef
    c[5, 0] += HOME
    return line, Trajectory(PPoly(c, [0.0, h]), np.array([0.0, line.end])), along


@pytest.mark.parametrize("size", [1e-7, 1e-4, 0.02])
@pytest.mark.parametrize("joint", range(6))
def test_no_instant_contradicts_the_bound_from_the_joints_on_one_interval(
    monkeypatch: pytest.MonkeyPatch, joint: int, size: float
) -> None:
    monkeypatch.setattr(path_errors, "ERROR_INTERVALS", 0)
    robot, (line, motion, along) = optik.load("ur5e"), one_joint_off(joint, size)
    proved, _ = path_errors.path_error(robot, line, motion)
    t = np.linspace(0.0, motion.end, 401)
    tool = robot.fk(motion(t))
    nearest = line.pose(np.clip(line.end * along(t), 0.0, line.end))
    off = np.linalg.norm(tool[:, :3, 3] - nearest[:, :3, 3], axis=1).max()
    assert off <= proved.distance * (1.0 + 1e-9)
    turned = np.linalg.norm(np.swapaxes(tool[:, :3, :3], 1, 2) @ nearest[:, :3, :3] - np.eye(3), axis=(1, 2)).max()
    assert 2.0 * np.arcsin(turned / np.sqrt(8.0)) <= proved.angle * (1.0 + 1e-9) + 1e-15
    assert proved.distance <= 20.0 * size, "the bound is of the size of the error"


def test_a_tolerance_below_a_nanometre_is_proved_by_more_intervals(monkeypatch: pytest.MonkeyPatch) -> None:
    robot, (line, motion, _) = optik.load("ur5e"), one_joint_off(1, 5e-10)
    with monkeypatch.context() as patch:
        patch.setattr(path_errors, "ERROR_INTERVALS", 0)
        rough = path_errors.path_error(robot, line, motion)[0].distance
    assert rough < 1e-9
    for share, valid in ((0.93, True), (0.1, False)):
        proof = certify(robot, line, motion, LIMITS, enforced=(), tolerance=(share * rough, 1e-9))
        assert proof.is_valid == valid, proof.reasons


# ---------------------------------------------------------------- a tool that turns fast
@pytest.mark.parametrize("count", [60, 100])
def test_a_tool_that_turns_fast_along_a_dense_seam_is_proved(count: int) -> None:
    """Position alone decides only to nanometres where on the path the tool is, and the tool turns by 300 rad in a metre."""
    robot, u = optik.load("ur5e"), np.linspace(0.0, 1.0, count)
    tool = robot.fk(HOME)
    turns = [se3.exp_so3(np.array([0.0, 0.0, 1.2 * np.sin(4.0 * np.pi * x)])) for x in u]
    poses = [
        se3.pose(tool[:3, :3] @ R, tool[:3, 3] + [0.03 * x, 0.01 * np.sin(6.0 * x), 0.0])
        for R, x in zip(turns, u, strict=True)
    ]
    path = Polyline(poses, blend=1e-3)
    made = plan(robot, path, HOME, limits=MotionLimits(2.0, 10.0, 100.0), tolerance=TOLERANCE)
    assert made, made.failure
    assert made.certificate.path_error.angle <= 1e-7
    by_position, _ = path_errors.path_error(robot, path, made.trajectory, turn=1e-3)
    assert by_position.angle > TOLERANCE[1], "the nearest position by the distance alone is turned by more"


# ---------------------------------------------------------------- numbers beyond any arm
@pytest.mark.parametrize("factor", [1e2, 1e5, 1e9, 1e100, 1e300])
def test_a_motion_with_huge_numbers_is_refused_or_judged_with_few_intervals(
    monkeypatch: pytest.MonkeyPatch, factor: float
) -> None:
    made = cycle("ruckig", "home", "pick", "home")
    data = to_plain(made.motion)
    data["coefficients"] = (factor * np.array(data["coefficients"])).tolist()
    del data["sha256"]
    compared: list[int] = []
    divide: Any = path_errors.divide

    def counted(*given: Any) -> None:
        compared.append(given[3].shape[1])
        divide(*given)

    monkeypatch.setattr(path_errors, "divide", counted)
    try:
        motion = from_plain(data)
    except InvalidInput as error:
        assert factor >= 1e9
        assert "positions up to" in str(error)
    else:
        assert not motion.certify().is_valid
        assert motion.certify() is motion.certificate, "a motion keeps its certificate"
        assert sum(compared) <= 100_000


def test_a_motion_of_a_file_is_certified_once(tmp_path: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "cycle.json"
    cycle("ruckig", "home", "pick", "home").save(file)
    motion: Motion = planners.load_motion(file)
    proof = motion.certificate
    assert proof.is_valid
    monkeypatch.setattr("planners.motion.motion.certify", None)
    motion.check_valid()
    assert motion.certify() is proof


# ---------------------------------------------------------------- the kernel of the bound from the joints
PLANAR = Robot(
    "planar", np.array([oracles.trans(x=0.3), oracles.trans(x=0.5), oracles.trans(x=0.6)]), np.zeros(3, bool),
    oracles.trans(x=0.4), JointLimits([-np.inf] * 3, [np.inf] * 3),
)  # fmt: skip
"""Three joints about z. Stretched, an error of the first joint moves the tool by 1.5 m for each radian: as far as can be."""
Poly = np.polynomial.Polynomial


def bound_and_truth(way: list[Any], cut: list[Any], s: Any, h: float) -> tuple[Array, Array]:
    """The bounds of one interval of h, and the largest distance and angle of 4,001 instants; polynomials of joints and s(t)."""
    at, end = s(np.array([0.0, h])), 2.0
    ends = []
    for i, t in enumerate((0.0, h)):
        q = np.array([[p.deriv(k)(t) if k else p(t) for p in cut] for k in range(6)])[None]
        on = np.array([[p.deriv(k)(at[i]) if k else p(at[i]) for p in way] for k in range(2)])[None]
        ends.append(
            ComparedInstants(np.array([t]), q, at[i : i + 1], np.array([s.deriv()(t)]), on, np.zeros((1, 3, 12)))
        )
    x = np.linspace(0.0, end, 2001)
    bounds = np.array([[np.abs(p.deriv(k)(x)).max() * (1.0 + 1e-9) for p in way] for k in range(1, 5)])[None]
    links = np.linalg.norm([*PLANAR.fixed[:, :3, 3], PLANAR.tool[:3, 3]], axis=1)
    out = np.full((1, 2), np.inf)
    both = ComparedInstants(*(np.concatenate(pair) for pair in zip(*ends, strict=True)))
    interval = np.array([0]), np.array([1])
    joint_intervals((links, PLANAR.prismatic), (np.array([0.0, end]), bounds), end, both, interval, out)
    t = np.linspace(0.0, h, 4001)
    a, b = (PLANAR.fk(np.stack([p(y) for p in curves], axis=1)) for curves, y in ((cut, t), (way, s(t))))
    off = np.linalg.norm(a[:, :3, 3] - b[:, :3, 3], axis=1).max()
    turned = np.linalg.norm(np.swapaxes(a[:, :3, :3], 1, 2) @ b[:, :3, :3] - np.eye(3), axis=(1, 2)).max()
    return out[0], np.array([off, 2.0 * np.arcsin(turned / np.sqrt(8.0))])


@pytest.mark.parametrize("case", range(120))
def test_the_bound_from_the_joints_is_above_every_instant_and_close(case: int) -> None:
    """Cubic errors with any rates at the ends; the largest quartics between ends without error; and paths of fourth degree."""
    rng = np.random.default_rng([11, case])
    h, size, zero = rng.uniform(0.2, 1.0), 10.0 ** rng.uniform(-7.0, -4.0), Poly([0.0])
    s, still = Poly([0.3, 0.8]), [Poly([0.0, 0.1]), Poly([0.0]), Poly([0.0])]
    swell = Poly([0.0, 0.0, h * h, -2.0 * h, 1.0]) / h**4  # t² (h − t)²
    kind, factor = case % 3, np.inf
    if kind == 0:
        e = size * Poly(rng.normal(size=4) / h ** np.arange(4))
        way, cut = still, [still[0](s) + e, zero, zero]
    elif kind == 1:
        way, cut, factor = still, [still[0](s) + size * swell, zero, zero], 1.0 + 1e-5
    else:  # the motion is the cubic through the path's ends and rates
        way = [Poly([0.0, 0.1, 0.0, 0.0, size]), zero, zero]
        cut, factor = [(way[0](s) - size * 0.8**4 * h**4 * swell), zero, zero], 1.0 + 1e-5
    proved, truth = bound_and_truth(way, cut, s, h)
    assert (truth <= proved * (1.0 + 1e-6) + 1e-14).all()
    assert (proved <= factor * truth + 1e-12).all()


@pytest.mark.parametrize("points", [(1.0, 3.0, 0.0, 0.0), (0.0, 0.0, 3.0, 1.0), (0.0, 3.0, -3.0, 0.0)])
def test_cubic_errors_are_bounded_by_their_bezier_points(points: tuple[float, ...]) -> None:
    """The error grows from one end on, and is largest between."""
    h, s, still = 0.7, Poly([0.3, 0.8]), [Poly([0.0, 0.1]), Poly([0.0]), Poly([0.0])]
    for sign in (1e-5, -1e-5):
        a, b, c, d = sign * np.array(points)
        error = Poly(
            np.array([a, 3.0 * (b - a), 3.0 * (c - 2.0 * b + a), d - 3.0 * c + 3.0 * b - a]) / h ** np.arange(4)
        )
        proved, truth = bound_and_truth(still, [still[0](s) + error, *still[1:]], s, h)
        assert (truth <= proved * (1.0 + 1e-6)).all()
        assert proved[1] == pytest.approx(3e-5, rel=1e-6), "that of the control points"
