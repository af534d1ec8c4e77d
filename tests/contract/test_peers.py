"""What every IK peer owes a comparison: our model of the robot, answers to judge, no exception; and its absence explained."""

import os
from functools import cache

import numpy as np
import pytest

import optik
from benchmarks.blocks.entries import judged
from benchmarks.peers.base import Absent
from benchmarks.peers.ik import PEERS
from benchmarks.peers.ik.base import SolverPeer
from benchmarks.problems.near_start import near_start
from optik.registry import load_method, names
from tests.seeds import shift_seed

ROBOTS = ("paper6r", "panda", "ur5e")
"""A wrist-partitioned arm, a redundant one, and one without a spherical wrist."""

SLIDING = "irb910sc"
"""An arm with a prismatic joint and fewer than six joints."""

OUTSIDE = ("drake",) if "OPTIK_PEERS" in os.environ else ("drake", "optik_py", "placo")
"""Peers in environments of their own that may be absent: ``make test`` has made those of all but Drake, and says where."""

SLOW = {"ikpy": 12, "plain_casadi": 15, "scipy": 40, "drake": 40, "mink": 60, "pink": 60, "pytracik": 60}
"""Warm problems for those that take milliseconds each; the others are given 200."""

WITHOUT_MODEL = ("scipy",)
"""Peers that solve on our forward kinematics."""


@cache
def peer_of(name: str, robot: str) -> SolverPeer | Absent:
    try:
        return load_method(PEERS, name).build(optik.load(robot))  # type: ignore[no-any-return]
    except Absent as absent:
        return absent


def usable(name: str, robot: str) -> SolverPeer | None:
    """The peer; None where it refuses the robot, which its reason says."""
    peer = peer_of(name, robot)
    if not isinstance(peer, Absent):
        return peer
    if peer.outcome == "refused":
        assert f"does not support {robot}" in peer.why
        return None
    assert peer.outcome == "absent", peer.why
    assert name in OUTSIDE, peer.why
    pytest.skip(peer.why)


def called(peer: SolverPeer, target: optik.types.Array, q0: optik.types.Array) -> object:
    return peer.call(target.copy(), q0.copy()) if peer.takes_start else peer.call(target.copy())


@pytest.mark.parametrize("robot", [*ROBOTS, SLIDING])
@pytest.mark.parametrize("name", names(PEERS))
def test_its_model_is_ours_or_it_refuses(name: str, robot: str) -> None:
    arm, peer = optik.load(robot), usable(name, robot)
    if peer is None:
        return
    q = arm.limits.sample(np.random.default_rng(11), 1)[0]
    pose = peer.fk(q)
    assert (pose is None) == (name in WITHOUT_MODEL)
    if pose is not None:
        np.testing.assert_allclose(pose, arm.fk(q), atol=1e-9)


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("name", names(PEERS))
def test_it_solves_warm_problems_and_its_claims_hold(name: str, robot: str) -> None:
    arm, peer = optik.load(robot), usable(name, robot)
    if peer is None:
        return
    problems = near_start(arm, shift_seed(5), count=SLOW.get(name, 200), spreads=[0.1])
    raws = [called(peer, T, q) for T, q in zip(problems.targets, problems.starts, strict=True)]
    rows = judged(arm, problems.targets, [peer.read(raw).q for raw in raws], wraps=True)
    assert peer.version()
    assert rows["solved"].sum() >= 0.9 * len(rows)  # from 0.1 rad away; the measured shares are 97 % and more
    claims = [peer.read(raw).claimed for raw in raws]
    assert set(claims) in ({None}, {True}, {True, False})
    right = [solved for claim, solved in zip(claims, rows["solved"], strict=True) if claim]
    assert not right or np.mean(right) > 0.9


@pytest.mark.parametrize("name", names(PEERS))
def test_an_unreachable_pose_raises_nothing_and_is_not_claimed(name: str) -> None:
    arm, peer = optik.load("paper6r"), usable(name, "paper6r")
    target = arm.fk(arm.limits.middle)
    target[:3, 3] = (9.0, 0.5, 0.5)
    raw = called(peer, target, np.full(arm.n, 0.1))
    assert not judged(arm, target[None], [peer.read(raw).q], wraps=True)["solved"].any()
    assert not peer.read(raw).claimed


@pytest.mark.parametrize("name", names(PEERS))
def test_a_limit_on_iterations_is_kept_or_refused(name: str) -> None:
    arm = optik.load("paper6r")
    usable(name, "paper6r")
    kind = load_method(PEERS, name)
    if not kind.budgeted:
        with pytest.raises(Absent, match=r"^has no limit on iterations that can be set$"):
            kind.build(arm, iterations=2)
        return
    peer = kind.build(arm, iterations=2)
    problems = near_start(arm, 5, count=3, spreads=[0.5])
    raws = [called(peer, T, q) for T, q in zip(problems.targets, problems.starts, strict=True)]
    counts = [peer.read(raw).iterations for raw in raws]
    assert all(count is None or count <= 2 for count in counts)
    assert not judged(arm, problems.targets, [peer.read(raw).q for raw in raws], wraps=True)["solved"].all()
