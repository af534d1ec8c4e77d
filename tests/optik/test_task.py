"""What of a pose counts: masks, frames, axes and boxes, against a slow oracle; their Jacobian by finite differences."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import optik
from optik.arm.reach import outside_reach, reach_bound
from optik.errors import InvalidInput
from optik.ik import DLS
from optik.task import POSE, Task, as_task, task_error, task_rows
from tests import oracles
from tests.seeds import shift_seed

ARM = optik.load("paper6r")
BOX = (0.05, 0.0, 0.2, 0.3, 0.1, 0.0)
TASKS = [
    Task(), Task(frame="base"), *map(as_task, ("position", "rotation", "axis_x", "axis_y", "axis_z")),
    Task((1, 1, 1, 1, 0, 1), "base"), Task((0, 1, 0, 0, 1, 0)), Task((1, 0, 1, 0, 0, 1), "base"), Task(box=BOX),
    Task(box=BOX, frame="base"), Task((1, 1, 1, 1, 1, 0), box=BOX), Task((1, 0, 1, 0, 1, 0), "base", BOX),
]  # fmt: skip
each_task = pytest.mark.parametrize("task", TASKS, ids=str)


def plain_error(T, target, task):
    """The docstring of Task, word by word."""
    R, R_t = T[:3, :3], target[:3, :3]
    to_axes = R_t.T if task.frame == "target" else np.eye(3)
    D = R_t.T @ R if task.frame == "target" else R @ R_t.T
    turn = -Rotation.from_matrix(D).as_rotvec()
    free = [k for k in range(3) if not task.mask[3 + k]]
    if len(free) == 1:  # the shortest turn that brings the one axis onto the other
        axis = np.eye(3)[free[0]]
        across = np.cross(D @ axis, axis)
        angle = np.arctan2(np.linalg.norm(across), (D @ axis) @ axis)
        turn = angle * across / np.linalg.norm(across)
    e = np.concatenate([to_axes @ (target[:3, 3] - T[:3, 3]), turn])
    beyond = [np.sign(x) * max(abs(x) - side, 0.0) for x, side in zip(e, task.box, strict=True)]
    return np.where(task.mask, beyond, 0.0)


def compiled_error(T, target, task):
    e, w = np.empty(6), np.empty(3)
    task_error(T, target, task.flags, e, w)
    return e, w


def pairs(count, seed, spread=0.8):
    rng = np.random.default_rng(seed)
    for q in rng.uniform(ARM.limits.lower, ARM.limits.upper, (count, 6)):
        yield q, ARM.fk(q), ARM.fk(q + rng.normal(0.0, spread, 6))


@each_task
def test_the_error_is_what_the_words_say(task):
    for _, T, target in pairs(200, 91):
        assert np.abs(compiled_error(T, target, task)[0] - plain_error(T, target, task)).max() < 1e-11


@each_task
def test_the_rows_are_the_errors_derivative(task):
    for q, _, target in pairs(20, 92, 0.5):
        e, w = compiled_error(ARM.fk(q), target, task)
        J = ARM.jacobian(q).copy()
        task_rows(target, task.flags, w, J)
        h, free = 1e-6, 3 - sum(task.mask[3:])
        for k in range(6):
            step = h * np.eye(6)[k]
            slope = -(
                compiled_error(ARM.fk(q + step), target, task)[0] - compiled_error(ARM.fk(q - step), target, task)[0]
            )
            slope /= 2.0 * h
            # the geometric rows are those of a rotation vector only where it is small, but of a lone component always
            rows = [0, 1, 2] if free != 2 else list(range(6))
            rows = [i for i in rows if e[i] != 0.0 or not task.mask[i] or task.box[i] == 0.0]
            assert np.abs(J[rows, k] - slope[rows]).max() < 1e-7


LONE = [task for task in TASKS if 3 - sum(task.mask[3:]) == 2 and not any(task.box)]


@pytest.mark.parametrize("task", LONE, ids=str)
@pytest.mark.parametrize("size", [9e-4, 0.02])
def test_the_row_of_a_lone_rotation_is_right_to_second_order_in_a_small_angle(task, size):
    q = np.array([0.3, -0.5, 0.6, 0.4, 0.7, -0.2])
    for turn in size * np.array([[0.8, 0.0, 0.6], [0.6, 0.8, 0.0], [0.0, -0.6, 0.8]]):
        target = oracles.moved(ARM.fk(q), np.zeros(3), turn)
        _, w = compiled_error(ARM.fk(q), target, task)
        J = ARM.jacobian(q).copy()
        task_rows(target, task.flags, w, J)
        for k in range(6):
            step = np.eye(6)[k]
            slope = oracles.difference(
                lambda x, step=step, target=target: np.array([plain_error(ARM.fk(q + h * step), target, task) for h in x]),
                np.zeros(1), 0.02,
            )  # fmt: skip
            assert np.abs(J[3:, k] + slope[0, 3:]).max() < 2e-9  # a twelfth of the angle's square is 7e-8


@each_task
def test_a_damped_solver_reaches_it_and_the_judge_agrees(task):
    solver, solved = DLS(ARM, task=task), 0
    for q, _, target in pairs(10, shift_seed(93), 0.1):
        result = solver.solve(target, q)
        e = plain_error(ARM.fk(result.q), target, task)
        assert abs(result.position_error - np.linalg.norm(e[:3])) < 1e-12
        assert abs(result.rotation_error - np.linalg.norm(e[3:])) < 1e-8
        assert bool(result) == (result.position_error <= 1e-6 and result.rotation_error <= 1e-6)
        solved += bool(result)
    assert solved >= 5


def test_anywhere_in_the_box_is_as_good_as_the_target():
    task = Task(box=BOX)
    target = ARM.fk(np.full(6, 0.3))
    corner = target @ oracles.pose((0.0, 0.0999, 0.0), (0.0499, 0.0, -0.1999))
    assert np.abs(compiled_error(corner, target, task)[0]).max() < 1e-15
    beyond = target @ oracles.pose((0.0, 0.0, 0.0), (0.06, 0.0, -0.25))
    assert np.abs(compiled_error(beyond, target, task)[0] - [-0.01, 0, 0.05, 0, 0, 0]).max() < 1e-12


def test_a_number_is_a_box_of_six_and_a_box_is_no_longer_the_exact_pose():
    assert Task(box=0.1) == Task(box=(0.1,) * 6)
    assert Task(box=np.full(6, 0.1)) == Task(box=0.1)
    assert hash(Task(box=0.1)) == hash(Task(box=[0.1] * 6))
    assert not Task(box=0.1).is_pose
    assert POSE.is_pose
    assert POSE.flags.shape == (13,)
    assert (POSE.flags[7:] == 0.0).all()


@pytest.mark.parametrize("box", [-0.1, np.inf, np.nan, (0.1,) * 5, "wide", None, (0, 0, 0, 0, 0, -1e-9)])
def test_a_box_that_cannot_be_meant_is_refused_by_name(box):
    with pytest.raises(InvalidInput, match=r"^task\.box: "):
        Task(box=box)


def test_what_the_box_lets_in_is_not_proved_out_of_reach():
    exact, let_in = reach_bound(ARM, POSE), 0
    for task in (Task(box=(0.3, 0.3, 0.3, 0, 0, 0)), Task(box=(0, 0, 0, 0.5, 0.5, 0.5)), Task(box=0.2)):
        wider = reach_bound(ARM, task)
        rng = np.random.default_rng(shift_seed(94))
        for _ in range(300):
            T = ARM.fk(rng.uniform(ARM.limits.lower, ARM.limits.upper))
            b = np.array(task.box)
            near = T @ oracles.pose(*(rng.uniform(-1, 1, 6) * b * 0.57)[[[3, 4, 5], [0, 1, 2]]])
            if np.abs(compiled_error(T, near, task)[0]).max() < 1e-12:
                assert outside_reach(wider, near, 0.0, 0.0) < 0.0
                let_in += outside_reach(exact, near, 0.0, 0.0) >= 0.0
    assert let_in > 0  # of which some are out of reach without the box
