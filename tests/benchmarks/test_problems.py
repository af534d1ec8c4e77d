"""Hard targets are as hard as they say: singular, on the limits, at zero, by the oracle's own Jacobian."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from scipy.optimize import least_squares

import optik
from benchmarks.problems import base
from benchmarks.problems.base import known_solutions, put_at_zero, put_on_limits, random_stream, singular, start_of
from benchmarks.problems.hard import hard
from optik import DHRow, JointLimits, Robot
from optik.errors import InvalidInput
from optik.ik.problem import UNREACHABLE
from optik.registry import build_method
from tests import forks, oracles
from tests.seeds import shift_seed

SIX = ("paper6r", "puma560", "ur5e")


def seven_joints() -> Robot:
    twists, lengths = (0, -1, 1, -1, 1, -1, 1), (0.3, 0, 0.4, 0, 0.4, 0, 0.1)
    rows = [DHRow(alpha=0.5 * np.pi * s, d=d) for s, d in zip(twists, lengths, strict=True)]
    return Robot.from_mdh(rows, JointLimits(np.full(7, -2.0), np.full(7, 2.0)), name="seven")


@pytest.mark.parametrize("name", SIX)
@pytest.mark.parametrize("joint", [2, 4])
def test_singular_configurations_are_singular_by_the_oracle(name: str, joint: int) -> None:
    robot, arm = optik.load(name), oracles.table(name)
    q = singular(robot, np.random.default_rng(1), 12, joint, on_limits=False)
    assert q.shape == (12, 6)
    assert robot.limits.contains(q).all()
    for configuration in q:
        assert np.linalg.svd(oracles.jacobian(arm, configuration), compute_uv=False)[-1] < 1e-9


def test_at_a_spherical_wrist_the_outer_axes_are_parallel() -> None:
    robot, arm = optik.load("paper6r"), oracles.table("paper6r")
    for q in singular(robot, np.random.default_rng(2), 12, 4, on_limits=False):
        axes = oracles.jacobian(arm, q)[3:]
        assert np.linalg.norm(np.cross(axes[:, 3], axes[:, 5])) < 1e-9


def test_arms_with_seven_joints_have_singular_targets_too() -> None:
    robot = seven_joints()
    q = singular(robot, np.random.default_rng(3), 8, 4, on_limits=False)
    assert robot.limits.contains(q).all()
    assert np.linalg.svd(robot.jacobian(q), compute_uv=False)[:, -1].max() < 1e-9


def test_joints_are_put_on_their_limits_and_at_zero() -> None:
    robot, rng = optik.load("paper6r"), np.random.default_rng(4)
    q = put_on_limits(robot, rng, robot.limits.sample(rng, 50), but=4)
    on = (q == robot.limits.lower) | (q == robot.limits.upper)
    assert on.any(axis=1).all()
    assert not on[:, 4].any()
    zeros = put_at_zero(robot, rng, robot.limits.sample(rng, 50)) == 0.0
    assert zeros.any(axis=1).all()
    assert zeros[0].all()


def test_the_set_has_equal_shares_that_any_part_of_it_keeps() -> None:
    robot = optik.load("paper6r")
    problems = hard(robot, 7, count=100)
    names, counts = np.unique(problems.group, return_counts=True)
    assert list(counts) == [20] * 5
    assert set(problems.group[:40]) == set(names)
    wrist = np.char.startswith(problems.group, "wrist")
    assert problems.sigma[wrist | (problems.group == "elbow singular")].max() < 1e-9
    assert robot.limits.contains(problems.starts).all()


def test_warm_and_cold_starts_have_the_same_targets() -> None:
    robot = optik.load("paper6r")
    warm, cold = hard(robot, 7, count=25), hard(robot, 7, count=25, start_deg=[5.0] * 6)
    np.testing.assert_array_equal(warm.targets, cold.targets)
    np.testing.assert_allclose(cold.starts, np.deg2rad(5.0))
    assert np.isnan(cold.spread).all()
    np.testing.assert_array_equal(hard(robot, 7, count=25).starts, warm.starts)


def test_a_wrong_setting_is_named() -> None:
    robot = optik.load("paper6r")
    with pytest.raises(InvalidInput, match="count"):
        hard(robot, 1, count=4)
    with pytest.raises(InvalidInput, match="spread"):
        hard(robot, 1, spread=0.0)
    short = Robot.from_mdh([DHRow(d=0.1)] * 3, JointLimits(np.full(3, -1.0), np.full(3, 1.0)), name="short")
    with pytest.raises(InvalidInput, match="six joints"):
        hard(short, 1)


def test_a_start_is_given_in_degrees_and_of_sliding_joints_in_millimetres() -> None:
    arm = optik.load("irb910sc")
    given = np.where(arm.prismatic, 50.0, 30.0)
    q = start_of(arm, given)
    np.testing.assert_allclose(q, np.where(arm.prismatic, 0.05, np.pi / 6), atol=1e-15)
    with pytest.raises(InvalidInput, match="start_deg"):
        start_of(arm, given * 1e3)


# ---------------------------------------------------------------- known solutions, content hashes, starts

NEW_SETS = ("at_limits", "at_boundary", "beyond_reach", "singular_shells", "tracking", "random_reachable")


def drawn(name: str, robot: Robot, seed: int = 4, **options: Any) -> base.ProblemSet:
    return build_method(base.SETS, name, "problem set", robot, seed, **options)


def test_a_target_that_one_attempt_misses_is_known_and_one_out_of_reach_is_proved() -> None:
    robot = optik.load("paper6r")
    q = robot.limits.sample(np.random.default_rng(9), 200)
    targets = robot.fk(q)
    targets[0, :3, 3] += [0.0, 0.0, 5.0]
    starts = np.tile(robot.limits.middle, (200, 1))
    assert not optik.ik.make_solver(robot, "lm", max_restarts=0).solve_batch(targets, starts).solved.all()
    known = known_solutions(robot, targets, starts)
    assert list(np.flatnonzero(~known.found)) == list(np.flatnonzero(known.unreachable)) == [0]
    assert robot.limits.contains(known.q[1:]).all()
    np.testing.assert_allclose(oracles.fk(oracles.table("paper6r"), known.q[1:]), targets[1:], atol=2e-6)


def test_what_closed_forms_alone_find_counts_as_known() -> None:
    robot = optik.load("paper6r")
    q = robot.limits.sample(np.random.default_rng(9), 60)
    starts = np.tile(robot.limits.middle, (60, 1))
    few = optik.ik.make_solver(robot, "lm", max_restarts=0).solve_batch(robot.fk(q), starts).solved
    assert not few.all()
    assert known_solutions(robot, robot.fk(q), starts, restarts=0).found.all()


def test_the_paper_grid_knows_more_than_the_iteration_that_it_is_solved_by() -> None:
    options: dict[str, Any] = {"start_deg": [20, -35, 40, 25, 50, -30], "normals": ["Y"], "spacing_m": 0.1}
    grid = drawn("graph_paper", optik.load("paper6r"), **options)
    assert (grid.known & grid.unreachable).sum() == 0
    dls = optik.ik.make_solver(optik.load("paper6r"), "dls", max_restarts=15).solve_batch(grid.targets, grid.starts)
    assert not (dls.solved & ~grid.known).any()
    assert (np.isfinite(grid.sigma) == grid.known).all()


@pytest.mark.parametrize("name", NEW_SETS)
def test_the_first_problems_of_a_group_are_the_same_for_any_count(name: str) -> None:
    robot = optik.load("ur5e")
    options: dict[str, Any] = {"which": ["wrist"], "edges": [1e-4, 1e-2]} if name == "singular_shells" else {}
    few, many = drawn(name, robot, count=3, **options), drawn(name, robot, count=7, **options)
    assert few.sha256 != many.sha256
    for group in dict.fromkeys(few.group):
        for values in ("targets", "starts"):
            less = getattr(few, values)[few.group == group]
            np.testing.assert_array_equal(less, getattr(many, values)[many.group == group][: len(less)])
    assert drawn(name, robot, count=3, **options).sha256 == few.sha256
    assert drawn(name, robot, seed=5, count=3, **options).sha256 != few.sha256


def test_a_hash_is_the_same_in_another_process_and_out_of_the_table_of_a_run(tmp_path: Path) -> None:
    robot = optik.load("paper6r")
    problems = drawn("at_limits", robot, count=5)
    line = (
        "import optik; from benchmarks.problems.at_limits import at_limits as a; "
        "print(a(optik.load('paper6r'), 4, count=5).sha256)"
    )
    found = forks.start(line)().stdout.strip()
    problems.frame(robot).write_parquet(tmp_path / "problems.parquet")
    stored = pl.read_parquet(tmp_path / "problems.parquet")
    content = hashlib.sha256(f"{len(stored)} problems, {robot.n} joints\n".encode())
    for column in ("target", "start"):
        content.update(np.array(stored[column].to_list(), dtype="<f8").tobytes())
    assert found == problems.sha256 == content.hexdigest()
    moved = replace(problems, starts=np.nextafter(problems.starts, 9.0))
    assert moved.sha256 != problems.sha256


def test_starts_are_where_their_kind_says() -> None:
    robot = optik.load("paper6r")
    q = robot.limits.sample(random_stream(shift_seed(4), "q"), 300)
    at = {
        kind: base.start_configurations(robot.limits, random_stream(shift_seed(4), kind), q, kind, 0.1)
        for kind in base.START_KINDS
    }
    for starts in at.values():
        assert robot.limits.contains(starts).all()
    half = robot.limits.half
    np.testing.assert_allclose(np.abs(at["far"] - q), np.tile(half, (300, 1)), rtol=1e-12)
    assert 0.08 < np.std((at["near"] - q)[:, 0]) < 0.11
    np.testing.assert_array_equal(at["zero"], np.tile(np.clip(0.0, robot.limits.lower, robot.limits.upper), (300, 1)))
    several = drawn("at_limits", robot, count=4, joints=[1], starts=["near", "zero"])
    assert list(dict.fromkeys(several.group)) == ["1 joint at limits, near start", "1 joint at limits, zero start"]
    np.testing.assert_array_equal(several.targets[:4], several.targets[4:])
    for wrong in ({"starts": "middle"}, {"starts": []}, {"starts": "far", "start_deg": [0.0] * 6}):
        with pytest.raises(InvalidInput, match="starts"):
            drawn("at_limits", robot, **wrong)


# ---------------------------------------------------------------- each set is what it says, by the oracles


@pytest.mark.parametrize("name", SIX)
def test_shells_have_their_singular_values_beside_the_singularity_that_they_name(name: str) -> None:
    robot, arm = optik.load(name), oracles.table(name)
    edges = (1e-6, 1e-4, 1e-2)
    problems = drawn("singular_shells", robot, count=6, edges=edges, spread=1e-9)
    q = problems.starts  # the solution, but for 1e-9 rad
    sigma = oracles.smallest(arm, q)
    for kind in ("wrist", "elbow", "shoulder"):
        for low, high in pairwise(edges):
            mine = problems.group == f"{kind}, {low:g} ≤ σ < {high:g}"
            assert mine.sum() == 6
            assert (sigma[mine] >= low - 1e-8).all()
            assert (sigma[mine] < high + 1e-8).all()
    wrist = np.char.startswith(problems.group, "wrist")
    axes = oracles.jacobian(arm, q)[:, 3:]
    parallel = np.linalg.norm(np.cross(axes[..., 3], axes[..., 5]), axis=-1)
    assert parallel[wrist].max() < 0.5 < parallel[~wrist].max()
    turned = q.copy()
    turned[:, 1] += 0.4  # joint 2 changes neither wrist nor elbow, but the shoulder
    shoulder = np.char.startswith(problems.group, "shoulder")
    thin = sigma < 1e-4
    assert oracles.smallest(arm, turned)[thin & ~shoulder].max() < 1e-3
    assert oracles.smallest(arm, turned)[thin & shoulder].max() > 1e-3


def test_shells_of_other_arms_are_of_any_kind() -> None:
    robot = seven_joints()
    q = drawn("singular_shells", robot, count=4, edges=[1e-4, 1e-3], spread=1e-9).starts
    sigma = np.linalg.svd(oracles.jacobian(robot, q), compute_uv=False)[:, -1]
    assert ((sigma > 0.99e-4) & (sigma < 1.01e-3)).all()
    with pytest.raises(InvalidInput, match="which"):
        drawn("singular_shells", robot, which=["wrist"])
    with pytest.raises(InvalidInput, match="any"):
        drawn("singular_shells", optik.load("gen3lite"), count=20, which=["wrist"])


def test_so_many_joints_are_exactly_at_their_limits() -> None:
    robot, arm = optik.load("paper6r"), oracles.table("paper6r")
    problems = drawn("at_limits", robot, count=30, joints=[1, 4], spread=1e-12)
    near = problems.starts
    at = (np.abs(near - robot.limits.lower) < 1e-10) | (np.abs(near - robot.limits.upper) < 1e-10)
    assert (at[:30].sum(axis=1) == 1).all()
    assert (at[30:].sum(axis=1) == 4).all()
    np.testing.assert_allclose(oracles.fk(arm, near), problems.targets, atol=1e-10)
    with pytest.raises(InvalidInput, match="joints"):
        drawn("at_limits", robot, joints=[7])


@pytest.mark.parametrize("name", ["paper6r", "irb910sc"])
def test_nothing_lies_beyond_the_boundary_and_no_free_joint_leads_there(name: str) -> None:
    robot, arm = optik.load(name), oracles.table(name)
    problems = drawn("at_boundary", robot, count=8, spread=1e-12)
    q, p = problems.starts, problems.targets[:, :3, 3]
    d = random_stream(4, "at_boundary", "directions").normal(size=(8, 3))
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    others = oracles.fk(
        arm, np.random.default_rng(1).uniform(robot.limits.lower, robot.limits.upper, (20_000, robot.n))
    )
    assert ((others[:, :3, 3] @ d.T).max(axis=0) < np.einsum("ki,ki->k", p, d)).all()
    rise = np.einsum("ki,kij->kj", d, oracles.jacobian(arm, q)[:, :3])
    at_lower, at_upper = q < robot.limits.lower + 1e-9, q > robot.limits.upper - 1e-9
    assert np.abs(rise[~at_lower & ~at_upper]).max() < 1e-6
    assert (rise[at_lower] < 1e-6).all()
    assert (rise[at_upper] > -1e-6).all()


def test_no_search_comes_nearer_to_a_target_beyond_reach_than_its_excess() -> None:
    robot, arm = optik.load("ur5e"), oracles.table("ur5e")
    problems = drawn("beyond_reach", robot, count=1, excesses_m=[0.01, 0.1])
    assert problems.unreachable.all()
    assert not problems.known.any()
    for target, excess in zip(problems.targets, [0.01, 0.1], strict=True):

        def error(q: Any, target: Any = target) -> Any:
            T = oracles.fk(arm, q)
            return np.concatenate([T[:3, 3] - target[:3, 3], (T[:3, :3] - target[:3, :3]).ravel()])

        starts = np.random.default_rng(1).uniform(-2.0, 2.0, (3, 6))
        assert min(np.linalg.norm(least_squares(error, q).fun) for q in starts) > 0.3 * excess
    status = optik.ik.make_solver(robot, "lm").solve_batch(problems.targets, problems.starts).status
    assert (status == UNREACHABLE).all()
    with pytest.raises(InvalidInput, match="a proof"):
        drawn("beyond_reach", robot, excesses_m=[1e-7])


def test_a_sequence_takes_equal_steps_and_starts_where_the_last_one_ended() -> None:
    robot, arm = optik.load("puma560"), oracles.table("puma560")
    problems = drawn("tracking", robot, count=40, steps_m=[0.002, 0.02])
    for group, step in (("step 2 mm", 0.002), ("step 20 mm", 0.02)):
        mine = problems.group == group
        before = oracles.fk(arm, problems.starts[mine])
        np.testing.assert_allclose(before[1:], problems.targets[mine][:-1], atol=1e-12)
        moved = np.linalg.norm(problems.targets[mine][:, :3, 3] - before[:, :3, 3], axis=1)
        assert (moved < step * 1.001).all()
        assert moved.min() > 0.5 * step  # a chord, where the way bends
    with pytest.raises(InvalidInput, match="range_share"):
        drawn("tracking", robot, range_share=1.5)
