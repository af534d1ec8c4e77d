"""A batch is its single calls, to the last bit, whatever the number, the order and the threads; and it says what is wrong."""

import re
import subprocess
import sys
from functools import cache

import numpy as np
import pytest

import optik
from optik import IKStatus, Tolerance
from optik.errors import InvalidInput
from optik.ik import LM, make_solver
from tests import oracles
from tests.robots import built
from tests.seeds import shift_seed

PAPER, ARM = optik.load("paper6r"), oracles.table("paper6r")
STATUSES = tuple(IKStatus)
FIELDS = ("q", "status", "iterations", "restarts", "position_error", "rotation_error")


def problems(count, seed, arm=ARM):
    """Targets within reach, beyond it, and turned so that nothing solves them; starts anywhere."""
    rng = np.random.default_rng(seed)
    targets = oracles.fk(arm, rng.uniform(arm.lower, arm.upper, (count, arm.n)))
    targets[::5, 0, 3] += 3.0
    targets[1::5] = targets[1::5] @ oracles.pose((0.0, 2.0, 0.0), (0.0, 0.0, 0.0))
    return targets, rng.uniform(arm.lower, arm.upper, (count, arm.n))


def equal(a, b, order=slice(None)):
    for field in FIELDS:
        assert (getattr(a, field)[order] == getattr(b, field)).all(), field


def check_singles(solver, batch, targets, starts):
    for i, (target, start) in enumerate(zip(targets, starts, strict=True)):
        one = solver.solve(target, start)
        assert (one.q == batch.q[i]).all()
        assert one[1:6] == batch.result(i)[1:6]


@cache
def short():
    """The solver of most tests: made in a test, not where tests are collected, since its kernel is compiled then."""
    return LM(PAPER, max_restarts=20)


@pytest.mark.parametrize("count", [0, 1, 7, 8, 9, 15, 16, 17, 33, 300])
def test_a_batch_is_its_single_calls_to_the_last_bit(count):
    targets, starts = problems(count, shift_seed(201))
    batch = short().solve_batch(targets, starts)
    assert batch.q.shape == (count, 6)
    assert batch.status.shape == batch.iterations.shape == batch.position_error.shape == (count,)
    assert batch.solved.dtype == bool
    check_singles(short(), batch, targets, starts)
    if count == 300:
        assert 100 < batch.solved.sum() < 290
        assert {STATUSES[s] for s in batch.status} >= {IKStatus.SOLVED, IKStatus.UNREACHABLE}


def test_five_thousand_are_the_same_in_any_order_and_any_number_of_threads():
    targets, starts = problems(5000, 202)
    batch = short().solve_batch(targets, starts, threads=1)
    for threads in (2, 3, None):
        equal(batch, short().solve_batch(targets, starts, threads=threads))
    order = np.random.default_rng(203).permutation(5000)
    equal(batch, short().solve_batch(targets[order], starts[order]), order)
    some = np.arange(0, 5000, 50)
    check_singles(short(), batch._replace(**{f: getattr(batch, f)[some] for f in FIELDS}), targets[some], starts[some])
    p, r = oracles.off_by(oracles.fk(ARM, batch.q), targets)
    assert (batch.solved == ((p <= 1e-6) & (r <= 1e-6))).all()
    assert np.abs(batch.position_error - p).max() < 1e-12 * 10
    assert np.abs(batch.rotation_error - r).max() < 1e-8
    assert ((batch.q >= ARM.lower) & (batch.q <= ARM.upper)).all()


@pytest.mark.parametrize("n", [pytest.param(3, marks=pytest.mark.soak), 7])
def test_arms_of_other_lengths_too(n):
    arm = oracles.random_arm(np.random.default_rng(n), n, prismatic=n == 3)
    solver = LM(built(arm), max_restarts=5)
    targets, starts = problems(100, 204, arm)
    check_singles(solver, solver.solve_batch(targets, starts), targets, starts)


def test_attempts_that_hold_joints_at_their_limits_too():
    arm = oracles.table("panda")
    rng = np.random.default_rng(shift_seed(211))
    q = np.where(rng.random((150, 7)) < 0.5, arm.lower, arm.upper)
    q[:, 0] = rng.uniform(arm.lower[0], arm.upper[0], 150)
    targets, starts = oracles.fk(arm, q), np.full((150, 7), np.clip(0.1, arm.lower, arm.upper))
    solver = LM(optik.load("panda"))
    batch = solver.solve_batch(targets, starts)
    assert (batch.restarts > 16).sum() > 8  # the first that start on the limits
    check_singles(solver, batch, targets, starts)
    for threads in (1, 2, 3):
        equal(batch, solver.solve_batch(targets, starts, threads=threads))
    timed = solver.with_options(time_limit=60.0).solve_batch(targets, starts)
    equal(batch, timed._replace(q=batch.q, position_error=batch.position_error, rotation_error=batch.rotation_error))


@pytest.mark.parametrize(
    ("name", "options"),
    [("lm", {"task": "axis_z", "max_restarts": 2}), ("lm", {"prefer": "posture"}), ("lm", {"time_limit": 60.0}), ("dls", {})],
    ids=str,
)  # fmt: skip
def test_what_is_not_done_in_lanes_is_the_single_calls_too(name, options):
    solver = make_solver(PAPER, name, **options)
    targets, starts = problems(15, 205)
    batch = solver.solve_batch(targets, starts, threads=2)
    check_singles(solver, batch, targets, starts)
    equal(batch, optik.solve_ik_batch(PAPER, targets, starts, name, **options))


@pytest.mark.parametrize(
    "options", [{"max_iterations": 0}, {"max_iterations": 3, "max_restarts": 0}, {"max_restarts": 1}]
)
def test_the_limits_on_iterations_and_restarts_hold(options):
    solver = LM(PAPER, **options)
    targets, starts = problems(60, 206)
    batch = solver.solve_batch(targets, starts)
    assert (batch.restarts <= solver.max_restarts).all()
    assert (batch.iterations <= solver.max_iterations * (1 + batch.restarts)).all()
    check_singles(solver, batch, targets, starts)


def test_one_tolerance_for_all():
    targets, starts = problems(100, 207)
    batch = optik.solve_ik_batch(PAPER, targets, starts, tolerance=Tolerance(1e-3, 1e-9), max_restarts=5)
    p, r = oracles.off_by(oracles.fk(ARM, batch.q), targets)
    assert (batch.solved == ((p <= 1e-3) & (r <= 1e-9 + 1e-14))).all()
    assert batch.solved.any()


# ---------------------------------------------------------------- how it is given
def test_one_start_for_all():
    targets, _ = problems(20, 208)
    start = np.full(6, 0.3)
    equal(short().solve_batch(targets, start), short().solve_batch(targets, np.tile(start, (20, 1))))
    check_singles(short(), short().solve_batch(targets, start), targets, [start] * 20)


def test_how_the_numbers_are_kept_changes_nothing():
    targets, starts = problems(10, 209)
    starts = np.float64(np.float32(starts))
    starts = np.clip(starts, ARM.lower, ARM.upper)
    expected = short().solve_batch(targets, starts)
    wide = np.zeros((20, 8, 8))
    wide[::2, ::2, ::2] = targets
    frozen = targets.copy(), starts.copy()
    before = targets.copy(), starts.copy()
    for array in frozen:
        array.setflags(write=False)
    for T, q in [
        (targets.tolist(), starts.tolist()),
        (list(targets), tuple(starts)),
        (np.asfortranarray(targets), np.asfortranarray(starts)),
        (wide[::2, ::2, ::2], np.repeat(starts, 2, axis=1)[:, ::2]),
        frozen,
        (targets.astype(">f8"), np.longdouble(starts)),
    ]:
        equal(expected, short().solve_batch(T, q))
    assert (targets == before[0]).all()
    assert (starts == before[1]).all()
    whole = short().solve_batch(np.eye(4, dtype=int)[None], np.zeros((1, 6), int))
    equal(whole, short().solve_batch(np.eye(4)[None], np.zeros((1, 6))))


@pytest.mark.parametrize("targets", [[], np.empty((0, 4, 4)), np.empty(0)], ids=["list", "array", "flat"])
@pytest.mark.parametrize("starts", [[], np.empty((0, 6)), np.zeros(6)], ids=["list", "array", "one"])
def test_none_is_a_batch(targets, starts):
    batch = optik.solve_ik_batch(PAPER, targets, starts)
    assert batch.q.shape == (0, 6)
    assert batch.solved.shape == (0,)


GOOD = problems(9, 210)


def spoilt(which, index, value):
    targets, starts = GOOD[0].copy(), GOOD[1].copy()
    (targets if which == "targets" else starts)[index] = value
    return targets, starts


BAD = {
    "NaN": (*spoilt("targets", (4, 0, 3), np.nan), "targets[4]"),
    "infinite": (*spoilt("targets", (8, 1, 3), np.inf), "targets[8]"),
    "no rotation": (*spoilt("targets", (2, slice(3), slice(3)), 0.5), "targets[2]"),
    "a reflection": (*spoilt("targets", (3, slice(3), slice(3)), -np.eye(3)), "targets[3]"),
    "last row": (*spoilt("targets", (0, 3, 0), 0.1), "targets[0]"),
    "two wrong": (*spoilt("targets", ([3, 6], 0, 0), np.nan), "targets[3]"),
    "start NaN": (*spoilt("starts", (5, 1), np.nan), "starts[5]"),
    "start infinite": (*spoilt("starts", (1, 1), -np.inf), "starts[1]"),
    "start outside": (*spoilt("starts", ([7, 8], 4), 2.5), "starts[7]"),
    "one start outside": (GOOD[0], np.full(6, 3.1), "starts"),
    "too few starts": (GOOD[0], GOOD[1][:8], "starts"),
    "short starts": (GOOD[0], GOOD[1][:, :5], "starts"),
    "a pose": (GOOD[0][0], GOOD[1], "targets"),
    "rotations": (GOOD[0][:, :3, :3], GOOD[1], "targets"),
    "words": ("home", GOOD[1], "targets"),
    "None": (GOOD[0], None, "starts"),
    "complex": (GOOD[0] + 0j, GOOD[1], "targets"),
    "ragged": ([[1.0], [2.0, 3.0]], GOOD[1], "targets"),
}


@pytest.mark.parametrize("method", ["lm", "dls"])
@pytest.mark.parametrize(("targets", "starts", "argument"), BAD.values(), ids=BAD.keys())
def test_what_cannot_be_meant_is_refused_with_its_index(targets, starts, argument, method):
    with pytest.raises(InvalidInput, match="^" + re.escape(argument) + ": "):
        optik.solve_ik_batch(PAPER, targets, starts, method)


@pytest.mark.parametrize("threads", [0, -1, 1.5, True, "2"])
def test_no_such_number_of_threads(threads):
    with pytest.raises(InvalidInput, match="threads"):
        optik.solve_ik_batch(PAPER, *GOOD, threads=threads)


# ---------------------------------------------------------------- memory
PEAK = """
import resource, sys
import numpy as np, optik
robot = optik.load("paper6r")
q = np.random.default_rng(0).uniform(robot.limits.lower, robot.limits.upper, (200_000, 6))
targets, starts = robot.fk(q), np.clip(q + 0.01, robot.limits.lower, robot.limits.upper)
optik.solve_ik_batch(robot, targets[:20_000], starts[:20_000])  # compiled, threads made
unit = 1024 if sys.platform == "linux" else 1
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit
batch = optik.solve_ik_batch(robot, targets, starts)
after = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit
print(after - before - sum(field.nbytes for field in batch), batch.solved.sum())
"""


def test_beyond_what_comes_and_goes_a_batch_takes_no_memory_to_speak_of():
    pytest.importorskip("resource")
    done = subprocess.run(
        [sys.executable, "-c", PEAK], capture_output=True, text=True, check=True, cwd=oracles.REPOSITORY
    )
    extra, solved = map(int, done.stdout.split())
    assert extra < 12e6  # the targets alone are 25.6e6
    assert solved > 199_900
