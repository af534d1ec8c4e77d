"""closed_form: every branch against slow kinematics and brute force, at singularities and limits, by every backend."""

import itertools
import subprocess
import sys

import numpy as np
import pytest

import optik
from optik import IKStatus
from optik.arm.limits import JointLimits
from optik.arm.robot import Robot
from optik.errors import InvalidInput, MissingDependency
from optik.ik.closed_form import ClosedForm
from tests import oracles
from tests.outside import hide
from tests.robots import built
from tests.seeds import shift_seed

PI = np.pi
NAMES = ("paper6r", "puma560", "ur5e")
ENUMERATION = "enumeration (numerical, may be incomplete)"


@pytest.fixture(scope="module", params=["ssik", "eaik", "enumeration"])
def backend(request):
    if request.param != "enumeration":
        pytest.importorskip("eaik.IK_HP" if request.param == "eaik" else "ssik")
    return request.param


@pytest.fixture(scope="module", params=NAMES)
def known(request, backend):
    """One robot by one backend: (solver, table)."""
    return ClosedForm(optik.load(request.param), backend=backend), oracles.table(request.param)


def check(arm, target, found, tolerance=1e-9):
    """Every row meets the target by the slow kinematics, stands inside the limits, and is there once."""
    assert found.q.shape == (len(found.q), arm.n)
    e = oracles.error(oracles.fk(arm, found.q), np.broadcast_to(target, (len(found.q), 4, 4)))
    assert (np.abs(e) <= tolerance).all()
    assert (np.abs(np.linalg.norm(e[:, :3], axis=1) - found.position_error) < 1e-12).all()
    assert (np.abs(np.linalg.norm(e[:, 3:], axis=1) - found.rotation_error) < 1e-9).all()
    assert ((found.q >= arm.lower) & (found.q <= arm.upper)).all()
    for i, q in enumerate(found.q[1:], 1):
        assert not among(q, found.q[:i])


def among(q, rows, tolerance=1e-5):
    return len(rows) > 0 and np.abs(rows - q).max(axis=1).min() < tolerance


def turned(q):
    """Revolute joints in [−π, π)."""
    return (q + PI) % (2 * PI) - PI


def freed(robot):
    """The same arm with joints that turn once, whatever its limits."""
    limits = JointLimits(np.full(robot.n, -PI), np.full(robot.n, PI))
    return Robot(robot.name, robot.fixed, robot.prismatic, robot.tool, limits)


def singular(arm, joint, value, count, seed):
    q = oracles.configurations(arm, count, seed)
    q[:, joint] = value
    return q


# ---------------------------------------------------------------- branches
def test_the_configuration_that_made_a_target_is_among_its_branches(known):
    solver, arm = known
    for q in oracles.configurations(arm, 15, 1):
        target = oracles.fk(arm, q)
        found = solver.branches(target)
        check(arm, target, found)
        assert among(q, found.q)
        assert not found.free.any()


@pytest.mark.parametrize("name", ["paper6r", "puma560"])
def test_arms_with_a_spherical_wrist_have_eight_branches_in_free_joints(name, backend):
    arm, solver = oracles.table(name), ClosedForm(freed(optik.load(name)), backend=backend)
    for q in oracles.configurations(arm, 12, 2):
        found = solver.branches(oracles.fk(arm, q))
        assert len(found.q) == 8
        assert found.complete is (backend != "enumeration")
        # the wrist has two ways for each of four arms: q4 and q6 half a turn further, q5 turned about
        for a in found.q:
            other = turned(np.array([*a[:3], a[3] + PI, -a[4], a[5] + PI]))
            assert among(other, turned(found.q)) or among(other, turned(found.q + 1e-4) - 1e-4)


def test_every_winding_inside_two_turns_is_there(backend):
    arm, solver = oracles.table("ur5e"), ClosedForm(optik.load("ur5e"), backend=backend)
    for q in oracles.configurations(arm, 3, 3):
        target = oracles.fk(arm, q)
        found = solver.branches(target)
        roots = np.unique(np.round(turned(found.q), 6), axis=0)
        assert len(roots) in (2, 4, 6, 8)
        # brute force: of all whole turns of all branches, those inside
        expected = 0
        for root in roots:
            for k in itertools.product((-1, 0, 1), repeat=6):
                row = root + 2 * PI * np.array(k)
                if ((row >= arm.lower) & (row <= arm.upper)).all():
                    expected += 1
                    assert among(row, found.q, 1e-4)
        assert len(found.q) == expected == 64 * len(roots)


@pytest.mark.parametrize("name", NAMES)
def test_closed_forms_and_enumeration_find_the_same(name, backend):
    arm, robot = oracles.table(name), freed(optik.load(name))
    solver, search = ClosedForm(robot, backend=backend), ClosedForm(robot, backend="enumeration")
    differ = 0
    for q in oracles.configurations(arm, 20, shift_seed(4)):
        target = oracles.fk(arm, q)
        a, b = solver.branches(target).q, search.branches(target).q
        assert all(among(x, a) for x in b)  # what was found by search, the closed form has
        differ += len(a) != len(b)
    assert differ <= 1  # an enumeration may miss one: that is what its label says


def test_branches_come_in_one_order_and_nearest_first_where_asked(known):
    solver, arm = known
    q = oracles.configurations(arm, 1, 5)[0]
    target = oracles.fk(arm, q)
    found, again, near = solver.branches(target), solver.branches(target.tolist()), solver.branches(target, q)
    assert (found.q == again.q).all()
    rounded = [tuple(row) for row in np.round(found.q, 6)]
    assert rounded == sorted(rounded)
    assert np.abs(near.q[0] - q).max() < 1e-6
    distances = np.linalg.norm(near.q - q, axis=1)
    assert (np.diff(distances) >= 0).all()
    assert len(near.q) == len(found.q)


def test_another_librarys_kinematics_agree(known):
    pytest.importorskip("pinocchio")
    solver, arm = known
    other = oracles.Pinocchio(arm)
    target = other.fk(oracles.configurations(arm, 1, 6)[0])
    found = solver.branches(target)
    assert len(found.q)
    for q in found.q[:16]:
        assert np.abs(oracles.error(other.fk(q), target)).max() < 1e-9


def test_a_base_and_a_tool_are_part_of_the_arm(backend):
    base, tool = oracles.pose((0.4, -1.1, 0.6), (0.3, -0.2, 0.5)), oracles.pose((0.3, -0.5, 0.7), (0.02, 0.03, 0.1))
    robot, arm = optik.load("paper6r"), oracles.table("paper6r")
    fixed = robot.fixed.copy()
    fixed[0] = base @ fixed[0]
    solver = ClosedForm(Robot("moved", fixed, robot.prismatic, robot.tool @ tool, robot.limits), backend=backend)
    q = oracles.configurations(arm, 1, 7)[0]
    target = base @ oracles.fk(arm, q) @ tool
    assert among(q, solver.branches(target).q)


# ---------------------------------------------------------------- singularities and limits
def hard(name):
    arm = oracles.table(name)
    yield "wrist straight", singular(arm, 4, 0.0, 12, 11)
    elbow = {"paper6r": np.arctan2(-470.0, 55.0), "puma560": np.arctan2(20.3, 431.8) - PI / 2, "ur5e": 0.0}[name]
    yield "elbow stretched", singular(arm, 2, elbow, 12, 12)
    both = singular(arm, 4, 0.0, 8, 13)
    both[:, 2] = elbow
    yield "both", both
    q = oracles.configurations(arm, 12, 14)
    rng = np.random.default_rng(15)
    yield "on the limits", np.where(rng.random(q.shape) < 0.5, arm.lower, q)
    q = singular(arm, 4, 0.0, 8, 16)
    q[:, [0, 3]] = arm.upper[[0, 3]]
    yield "wrist straight, on the limits", q
    zeros = np.where(rng.random(q.shape) < 0.5, 0.0, q)
    zeros[0] = 0.0
    yield "zeros", np.clip(zeros, arm.lower, arm.upper)


def test_hard_targets_are_solved_and_no_farther_from_the_start_than_what_made_them(known):
    solver, arm = known
    rng = np.random.default_rng(17)
    for kind, configurations in hard(solver.robot.name):
        for q in configurations:
            target, start = oracles.fk(arm, q), np.clip(q + 0.1 * rng.normal(size=6), arm.lower, arm.upper)
            result = solver.solve(target, start)
            assert result, (kind, q, result)
            assert np.abs(oracles.error(oracles.fk(arm, result.q), target)).max() <= 1e-6
            assert ((result.q >= arm.lower - 1e-9) & (result.q <= arm.upper + 1e-9)).all()
            assert np.linalg.norm(result.q - start) <= np.linalg.norm(q - start) + 1e-5, kind


@pytest.mark.parametrize("name", ["paper6r", "puma560"])
def test_a_straight_wrist_is_represented_by_its_point_nearest_to_the_start(name, backend):
    arm, solver = oracles.table(name), ClosedForm(optik.load(name), backend=backend)
    for q in singular(arm, 4, 0.0, 5, 18):
        target = oracles.fk(arm, q)
        found = solver.branches(target, q)
        check(arm, target, found)
        assert found.free.any()
        assert not found.complete
        assert among(q, found.q, 1e-6)
        # the points of the curve through q, by brute force: none is nearer to another start than the answer
        start = np.clip(q + 0.2, arm.lower, arm.upper)
        t = np.linspace(-PI, PI, 2001)[:, None] * np.array([0, 0, 0, 1, 0, -1.0])
        curve = q + t
        curve = curve[((curve >= arm.lower) & (curve <= arm.upper)).all(axis=1)]
        answer = solver.solve(target, start).q
        assert np.linalg.norm(answer - start) <= np.linalg.norm(curve - start, axis=1).min() + 1e-6


def test_every_piece_of_a_straight_wrists_curve_is_there(backend):
    arm, robot = oracles.table("puma560"), optik.load("puma560")
    found = ClosedForm(robot, backend=backend)
    for q in singular(arm, 4, 0.0, 5, 19):
        rows = found.branches(oracles.fk(arm, q)).q
        same_arm = rows[np.abs(turned(rows[:, :3] - q[:3])).max(axis=1) < 1e-6]
        sums = np.unique(np.round((same_arm[:, 3] + same_arm[:, 5] - q[3] - q[5]) / (2 * PI), 4))
        low, high = arm.lower[3] + arm.lower[5], arm.upper[3] + arm.upper[5]
        possible = [k for k in range(-3, 4) if low <= q[3] + q[5] + 2 * PI * k <= high]
        assert sums.tolist() == possible


def test_a_limit_of_half_a_turn_is_both_ends(backend):
    arm, solver = oracles.table("paper6r"), ClosedForm(optik.load("paper6r"), backend=backend)
    q = np.array([PI, 0.3, -0.2, 0.4, 0.5, -0.6])
    rows = solver.branches(oracles.fk(arm, q)).q
    assert among(q, rows)
    assert among(q - 2 * PI * np.eye(6)[0], rows)


def test_branches_only_outside_the_limits_are_said_to_be(backend):
    arm, robot = oracles.table("paper6r"), optik.load("paper6r")
    narrow = JointLimits(np.full(6, -0.1), np.full(6, 0.1))
    solver = ClosedForm(Robot("narrow", robot.fixed, robot.prismatic, robot.tool, narrow), backend=backend)
    target = oracles.fk(arm, [0.8, 0.5, -0.4, 0.3, 0.9, -0.7])
    result = solver.solve(target, np.zeros(6))
    assert result.status is IKStatus.OUTSIDE_LIMITS
    assert (np.abs(result.q) <= 0.1).all()
    assert solver.branches(target).q.shape == (0, 6)
    assert "0 configurations" in solver.branches(target).message


def test_what_no_branch_meets_is_stalled_and_what_is_too_far_is_proved_so(backend):
    solver = ClosedForm(optik.load("paper6r"), backend=backend)
    far = oracles.trans(x=5.0) @ oracles.fk(oracles.table("paper6r"), np.zeros(6))
    assert solver.solve(far, np.zeros(6)).status is IKStatus.UNREACHABLE
    assert len(solver.branches(far).q) == 0
    # within the bound, but with the tool turned so that the wrist is beyond the links
    ur5e, arm = ClosedForm(optik.load("ur5e"), backend=backend), oracles.table("ur5e")
    result = ur5e.solve(oracles.pose((-1.7, 1.3, 1.1), (-0.4, 0.5, -0.6)), np.zeros(6))
    assert result.status is IKStatus.STALLED
    assert ENUMERATION in result.message
    assert ((result.q >= arm.lower) & (result.q <= arm.upper)).all()


# ---------------------------------------------------------------- joints of other kinds
def test_a_joint_without_an_end_has_the_winding_nearest_to_the_start(backend):
    arm, robot = oracles.table("paper6r"), optik.load("paper6r")
    lower, upper = robot.limits.lower.copy(), robot.limits.upper.copy()
    lower[5], upper[5], upper[0] = -np.inf, np.inf, np.inf
    endless = Robot("endless", robot.fixed, robot.prismatic, robot.tool, JointLimits(lower, upper))
    solver = ClosedForm(endless, backend=backend)
    q = np.array([0.4, 0.3, -0.2, 0.4, 0.5, 1.0])
    far = q + 2 * PI * np.array([3, 0, 0, 0, 0, -7])
    target = oracles.fk(arm, q)
    assert np.abs(solver.solve(target, far).q - far).max() < 1e-8
    assert among(far, solver.branches(target, far).q)
    assert among(q, solver.branches(target).q)


def test_a_joint_that_turns_very_often_is_cut_short_and_says_so(backend):
    robot = optik.load("paper6r")
    limits = JointLimits(np.full(6, -100.0), np.full(6, 100.0))
    solver = ClosedForm(Robot("reel", robot.fixed, robot.prismatic, robot.tool, limits), backend=backend)
    q = np.array([30.4, -20.3, 60.2, 0.4, 10.5, 1.0])
    found = solver.branches(robot.fk(q), q)
    assert not found.complete
    assert np.abs(found.q[0] - q).max() < 1e-8
    assert len(found.q) <= 8 * 4096
    assert np.abs(solver.solve(robot.fk(q), q).q - q).max() < 1e-8


def test_a_locked_joint_stays_where_it_is(backend):
    arm, robot = oracles.table("paper6r"), optik.load("paper6r")
    lower, upper = robot.limits.lower.copy(), robot.limits.upper.copy()
    lower[5] = upper[5] = 0.7
    solver = ClosedForm(Robot("five", robot.fixed, robot.prismatic, robot.tool, JointLimits(lower, upper)))
    q = np.array([0.4, 0.3, -0.2, 0.4, 0.5, 0.7])
    found = solver.branches(oracles.fk(arm, q))
    assert among(q, found.q)
    assert (found.q[:, 5] == 0.7).all()
    other = oracles.fk(arm, [0.4, 0.3, -0.2, 0.4, 0.5, 0.9])
    assert not solver.solve(other, robot.limits.clip(q))


def test_a_sliding_joint_and_a_general_arm_are_enumerated():
    rng = np.random.default_rng(21)
    for arm in (oracles.random_arm(rng, prismatic=True), oracles.random_arm(rng), oracles.random_arm(rng, 5)):
        solver = ClosedForm(built(arm))
        assert solver.label == ENUMERATION
        for q in oracles.configurations(arm, 5, 22):
            target = oracles.fk(arm, q)
            result = solver.solve(target, np.clip(q + 0.05, arm.lower, arm.upper))
            assert result
            assert np.abs(oracles.error(oracles.fk(arm, result.q), target)).max() <= 1e-6
            found = solver.branches(target, q)
            check(arm, target, found)
            assert among(q, found.q)
            assert found.backend == ENUMERATION
            assert not found.complete
        for name in ("ssik", "eaik"):
            with pytest.raises((InvalidInput, MissingDependency), match=r"enumeration|closed-form"):
                ClosedForm(built(arm), backend=name)


def iiwa():
    turn, lengths = [-PI / 2, PI / 2, PI / 2, -PI / 2, -PI / 2, PI / 2, 0.0], [0.34, 0, 0.4, 0, 0.4, 0, 0.126]
    rows = tuple(oracles.Row(alpha=a, d=d) for a, d in zip(turn, lengths, strict=True))
    ranges = np.radians([170, 120, 170, 120, 170, 120, 175])
    arm = oracles.Arm("dh", rows, lower=-ranges, upper=ranges)
    robot = Robot.from_dh([dict(alpha=r.alpha, d=r.d) for r in rows], JointLimits(-ranges, ranges), name="seven")
    return robot, arm


@pytest.mark.parametrize("seven", ["ssik", "enumeration"])
def test_a_redundant_arm_gives_samples_and_the_one_nearest_to_the_start(seven):
    if seven == "ssik":
        pytest.importorskip("ssik")
    robot, arm = iiwa()
    solver = ClosedForm(robot, backend=seven)
    rng = np.random.default_rng(23)
    for q in oracles.configurations(arm, 4, 24):
        target, start = oracles.fk(arm, q), np.clip(q + 0.1 * rng.normal(size=7), arm.lower, arm.upper)
        found = solver.branches(target, start)
        check(arm, target, found)
        assert len(found.q) >= 8
        assert not found.complete
        assert found.free.all()
        result = solver.solve(target, start)
        assert result
        assert np.linalg.norm(result.q - start) <= np.linalg.norm(found.q - start, axis=1).min() + 1e-9
        assert "samples" in result.message


def test_eaik_has_no_seven_joints():
    pytest.importorskip("eaik.IK_HP")
    with pytest.raises(InvalidInput, match=r"^backend: .*'enumeration'.*'eaik'.*seven"):
        ClosedForm(iiwa()[0], backend="eaik")


# ---------------------------------------------------------------- backends
def test_without_either_package_it_enumerates_and_says_so(monkeypatch):
    hide(monkeypatch, "ssik", "eaik")
    robot, arm = optik.load("paper6r"), oracles.table("paper6r")
    solver = ClosedForm(robot)
    q = oracles.configurations(arm, 1, 25)[0]
    assert solver.label == solver.branches(oracles.fk(arm, q)).backend == ENUMERATION
    result = solver.solve(oracles.fk(arm, q), np.zeros(6))
    assert result
    assert result.message.startswith(ENUMERATION)
    assert result.iterations > 0


@pytest.mark.parametrize("name", ["ssik", "eaik"])
def test_a_named_package_that_is_missing_names_the_extra(monkeypatch, name):
    hide(monkeypatch, name)
    with pytest.raises(MissingDependency, match=rf"needs the package {name}.*optik-toolkit\[closed-form\]") as caught:
        ClosedForm(optik.load("paper6r"), backend=name)
    assert caught.value.package == name


def test_the_first_package_that_is_there_answers(monkeypatch):
    pytest.importorskip("ssik")
    hide(monkeypatch, "eaik")
    solver = ClosedForm(optik.load("paper6r"))
    assert solver.label == "ssik"
    assert solver.solve(optik.load("paper6r").fk(np.full(6, 0.3)), np.zeros(6)).message.startswith("ssik")


class Broken:
    """A closed form that names nothing, rubbish, or falls over."""

    def __init__(self, answer):
        self.answer = answer

    def __call__(self, pose):
        if isinstance(self.answer, Exception):
            raise self.answer
        return self.answer


@pytest.mark.parametrize(
    "answer",
    [RuntimeError("no"), [], np.full((8, 6), np.nan), np.random.default_rng(0).uniform(-3, 3, (8, 6)), [[1.0]]],
)
def test_a_closed_form_that_is_wrong_is_repaired_or_replaced_by_search(answer):
    pytest.importorskip("ssik")
    arm, solver = oracles.table("paper6r"), ClosedForm(optik.load("paper6r"), backend="ssik")
    solver._backend._solve = Broken(answer)
    for q in oracles.configurations(arm, 5, 26):
        target = oracles.fk(arm, q)
        result = solver.solve(target, q)
        assert np.abs(oracles.error(oracles.fk(arm, q), target)).max() < 1e-9
        if isinstance(answer, np.ndarray) and np.isfinite(answer).all():
            continue  # Newton's method may come from rubbish to some branch, inside or not
        assert result
        assert "enumeration" in result.message


def test_a_package_that_answers_wrongly_is_not_taken(monkeypatch):
    pytest.importorskip("ssik")
    from optik.ik import closed_form

    monkeypatch.setattr(closed_form, "_build_ssik", lambda axes: lambda pose: np.full((2, 6), 0.1))
    with pytest.raises(InvalidInput, match=r"ssik.*poses"):
        ClosedForm(optik.load("paper6r"), backend="ssik")
    hide(monkeypatch, "eaik")
    assert ClosedForm(optik.load("paper6r")).label == ENUMERATION


def test_importing_and_listing_load_neither_package():
    code = "import sys, optik, optik.ik.closed_form; print(*(m for m in ('ssik', 'eaik') if m in sys.modules))"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=oracles.REPOSITORY
    )
    assert done.stdout.split() == []


# ---------------------------------------------------------------- as a method
@pytest.mark.parametrize("task", ["position", "axis_z"])
def test_only_the_whole_pose_can_be_asked_for(task):
    with pytest.raises(InvalidInput, match="closed_form can"):
        ClosedForm(optik.load("paper6r"), task=task)


@pytest.mark.parametrize("wrong", ["SSIK", "", None, 3])
def test_an_unknown_backend_is_refused(wrong):
    with pytest.raises(InvalidInput, match='backend: expected "auto" or "ssik" or "eaik" or "enumeration"'):
        ClosedForm(optik.load("paper6r"), backend=wrong)


def test_branches_refuse_what_solve_refuses():
    solver = ClosedForm(optik.load("paper6r"), backend="enumeration")
    with pytest.raises(InvalidInput, match="target"):
        solver.branches(np.eye(3))
    with pytest.raises(InvalidInput, match="q0"):
        solver.branches(np.eye(4), np.full(6, 9.0))


@pytest.mark.parametrize("elbow", ["folds", "flips", "stands"])
def test_a_curve_of_solutions_that_leaves_between_two_lost_directions_is_free(elbow, backend):
    """A UR5e whose wrist is straight and elbow stretched: the joints 2, 3, 4, 6 are a four-bar linkage, all in a line.

    The shortest bar and the longest are as long together as the others (a change point): two curves cross there. With
    the last bar stretched too there is nothing longer: the configuration stands alone.
    """
    robot = optik.load("ur5e")
    arm, solver = oracles.table("ur5e"), ClosedForm(robot, backend=backend)
    wrist, last = {"folds": (0.0, PI / 2), "flips": (PI, PI / 2), "stands": (0.0, -PI / 2)}[elbow]
    for first, shoulder, hand in ((0.3, -0.8, 0.2), (-1.1, -1.9, 1.4), (1.7, 0.6, -0.9)):
        q = np.array([first, shoulder, 0.0, last, wrist, hand])
        found = solver.branches(oracles.fk(arm, q), q)
        near = (
            np.abs(found.q - q).max(axis=1) < 1e-5
        )  # two solutions in one: rounding of 1e-11 in the pose is 4e-6 in q
        assert near.any()
        assert (found.free[near] == (elbow != "stands")).all()


def test_a_curve_of_solutions_of_an_arm_with_rounded_numbers_is_no_list_of_isolated_points():
    """Universal Robots' description rounds half π to nine digits: points of the curve meet the target to 1e-10 only."""
    robot, rng = optik.load("ur5e"), np.random.default_rng(31)
    fixed = robot.fixed.copy()
    for i in range(1, 6):
        fixed[i] = fixed[i] @ oracles.rot_x(2.05e-10 * rng.choice([-1.0, 1.0]))
    solver = ClosedForm(Robot("rounded", fixed, robot.prismatic, robot.tool, robot.limits))
    for wrist in (PI, -PI, 0.0):
        q = rng.uniform(-3.0, 3.0, 6)
        q[4] = wrist
        found = solver.branches(solver.robot.fk(q), q)
        isolated = np.unique(np.round(turned(found.q[~found.free] + 1e-3), 3), axis=0)
        assert found.free.any()
        assert among(q, found.q[found.free], 1e-3)
        assert len(isolated) <= 8


def test_a_straight_wrist_of_an_arm_with_rounded_numbers_has_its_branch():
    """Its three axes miss one another by 1e-7 m: the search inside the limits meets the target within the tolerance only."""
    robot, rng = optik.load("puma560"), np.random.default_rng(33)
    for _ in range(10):
        fixed = robot.fixed.copy()
        fixed[:, :3, 3] += 1e-7 * rng.choice([-1.0, 1.0], (6, 3))
        solver = ClosedForm(Robot("rounded", fixed, robot.prismatic, robot.tool, robot.limits), backend="enumeration")
        for q in robot.limits.sample(rng, 10):
            q[4] = 0.0
            target = solver.robot.fk(q)
            found = solver.branches(target)
            assert 0 < len(found.q) <= 64
            assert np.abs(solver.robot.pose_errors(found.q, target)).max() < 1e-6


@pytest.mark.parametrize("limit", [1e-6, 1e-7, -1e-7, 1e-8])
def test_an_almost_straight_wrist_at_a_limit_has_its_branch(limit):
    """The closed form takes such a wrist for straight: its roots miss the target by more than rounding."""
    pytest.importorskip("eaik.IK_HP")
    robot, arm, rng = optik.load("paper6r"), oracles.table("paper6r"), np.random.default_rng(32)
    lower, upper = robot.limits.lower.copy(), robot.limits.upper.copy()
    lower[[1, 2]], upper[[1, 2]], lower[4] = 0.4 * lower[[1, 2]], 0.4 * upper[[1, 2]], limit
    solver = ClosedForm(Robot("wrist", robot.fixed, robot.prismatic, robot.tool, JointLimits(lower, upper)))
    for _ in range(20):
        q = np.where(rng.random(6) < 0.5, np.where(rng.random(6) < 0.5, lower, upper), rng.uniform(lower, upper))
        q[4] = limit
        target = oracles.fk(arm, q)
        found, start = solver.branches(target), rng.uniform(lower, upper)
        assert len(found.q)
        assert (
            np.abs(oracles.error(oracles.fk(arm, found.q), np.broadcast_to(target, (len(found.q), 4, 4)))).max() < 1e-6
        )
        assert solver.solve(target, start)
