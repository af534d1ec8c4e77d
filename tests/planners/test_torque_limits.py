"""Limits on torque and its rate: in plans of every law, in certificates, in files, and where gravity forbids a path."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import PPoly

import optik
from optik.dynamics import torques_batch
from optik.errors import InvalidInput
from optik.types import Array
from planners import MotionLimits, Plan, Trajectory, certify, load_motion, make_law, plan, replan, save
from planners.certificate.analysis import MotionAnalysis
from planners.certificate.bounds import MotionBounds
from planners.following.joint_path import JointPath
from planners.limits import DERIVATIVES, PathPoints, kind_of
from planners.limits.kinds import torque_rows
from planners.motion.motion import static_torque
from planners.timing import TimeLaw
from planners.timing.smooth import Smooth
from planners.trajectory.curve import apply_chain_rule
from tests.planners.cases import START, default_line, paper6r
from tests.planners.torques import loaded, values

COULOMB = 0.4
"""Coulomb friction of the arm in these tests [N·m]."""
OUR = (2.0, 10.0, 100.0)


def robot(payload: float | tuple[float, float] | None = 1.0):
    return loaded(coulomb=COULOMB).with_payload(payload, com=(0.02, 0.0, 0.05))


def needed(found: Plan, *, rate: bool) -> Array:
    """Largest torque or rate of every joint in a plan's motion, at dense instants."""
    motion, t = found.trajectory, np.linspace(0.0, found.trajectory.end, 20001)
    most = np.zeros(found.robot.n)
    for load in found.robot.loads:
        out = values(found.robot, motion, t, load)
        friction = 0.0 if rate else COULOMB * np.sign(motion(t, 1))
        most = np.maximum(most, np.abs(out[:, int(rate)] + friction).max(axis=0))
    return most


def static(found: Plan) -> Array:
    one = np.stack([-np.ones(6), np.ones(6)])
    joints = found.joint_path
    return static_torque(found.robot, Trajectory(PPoly(joints.coefficients, joints.nodes)), one).found


def test_static_torque_is_that_of_gravity_and_friction_along_the_path() -> None:
    found = plan(robot(), default_line(), START, limits=MotionLimits(*OUR))
    s = np.linspace(0.0, found.joint_path.end, 4001)
    q, q1 = found.joint_path(s), found.joint_path(s, 1)
    still = np.zeros_like(q)
    torque = np.empty((s.size, 2, 6))
    load = robot().loads[0]
    torques_batch(
        robot().chain, load.bodies, load.viscous, np.ascontiguousarray(np.stack([q] + [still] * 3, axis=1)), torque
    )
    along = np.abs(torque[:, 0] + COULOMB * np.sign(q1)).max(axis=0)
    expected = np.maximum(along, np.abs(torque[[0, -1], 0]).max(axis=0) + COULOMB)
    assert static(found) == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize("law", ["optimal", "smooth", "ruckig", "constant_speed"])
@pytest.mark.parametrize("payload", [1.0, (0.0, 2.0)], ids=["one", "interval"])
def test_laws_keep_torque_and_its_rate(law: str, payload: float | tuple[float, float]) -> None:
    arm = robot(payload)
    free = plan(arm, default_line(), START, limits=MotionLimits(*OUR), timing=law)
    assert np.isnan(free.certificate.torque.value).all() and free.certificate.energy is None
    torque = static(free) + 0.5 * np.maximum(needed(free, rate=False) - static(free), 1e-2)
    rate = 0.7 * needed(free, rate=True)
    for limits in (
        MotionLimits(*OUR, torque=torque),
        MotionLimits(*OUR, torque_rate=rate),
        MotionLimits(*OUR, torque=torque, torque_rate=rate),
    ):
        found = plan(arm, default_line(), START, limits=limits, timing=law)
        assert found, found.failure
        proof = found.certificate
        assert proof.is_valid and "torque" in proof.enforced
        for name, bound in (("torque", limits.torque), ("torque_rate", limits.torque_rate)):
            if bound is None:
                assert np.isnan(proof.extreme(name).ratio).all()
                continue
            most = needed(found, rate=name == "torque_rate") / bound
            assert (most <= proof.extreme(name).ratio * (1.0 + 1e-9)).all()
            assert proof.extreme(name).ratio.max() <= 1.0
            assert proof.extreme(name).value == pytest.approx(proof.extreme(name).ratio * bound)
        binding = max(
            proof.worst(name)[0]
            for name in ("torque", "torque_rate", "velocity", "acceleration", "jerk")
            if not np.isnan(proof.worst(name)[0])
        )
        assert binding > 0.97
        assert found.trajectory.duration > free.trajectory.duration
        if law == "optimal":
            assert {"torque", "torque_rate"} & set(proof.binding.limit)


def test_quintic_promises_no_torque_and_is_certified() -> None:
    arm = robot()
    found = plan(arm, default_line(), START, limits=MotionLimits(*OUR, torque=5.0, torque_rate=50.0), timing="quintic")
    assert found.certificate.worst("torque")[0] > 1.0
    assert found.certificate.torque.ratio.max() * 5.0 >= needed(found, rate=False).max() * (1.0 - 1e-9)


class Own(TimeLaw):
    """A law that knows nothing of torques."""

    enforced = DERIVATIVES

    def _time(self, joint_path: JointPath, limits: MotionLimits) -> Trajectory:
        only = limits.select(DERIVATIVES)
        return make_law("smooth").run(joint_path, only)


def test_a_law_that_knows_no_torques_is_slowed_until_it_keeps_them_or_refused() -> None:
    free = plan(robot(), default_line(), START, limits=MotionLimits(*OUR), timing=Own())
    torque = static(free) + 0.5 * np.maximum(needed(free, rate=False) - static(free), 1e-2)
    limits = MotionLimits(*OUR, torque=torque, torque_rate=0.9 * needed(free, rate=True))
    found = plan(robot(), default_line(), START, limits=limits, timing=Own())
    assert found and found.stretch_factor > 1.0 and {"torque", "torque_rate"} <= set(found.certificate.enforced)
    assert found.certificate.worst("torque")[0] == pytest.approx(1.0, abs=1e-4)
    refused = plan(robot(), default_line(), START, limits=limits, timing=Own(), strict=True)
    assert refused.status == "limits_exceeded" and refused.failure is not None and "torque" in refused.failure.reason


def test_a_certificate_names_the_torque_that_a_motion_passes() -> None:
    arm = robot()
    free = plan(arm, default_line(), START, limits=MotionLimits(*OUR), timing="toppra")
    torque = static(free) + 0.5 * np.maximum(needed(free, rate=False) - static(free), 1e-2)
    certificate = certify(arm, default_line(), free.trajectory, MotionLimits(*OUR, torque=torque))
    assert certificate.worst("torque")[0] > 1.0 and any("torque of joint" in words for words in certificate.reasons)


@pytest.mark.parametrize("law", ["optimal", "smooth", "constant_speed"])
def test_a_path_that_gravity_forbids_is_refused_with_joint_place_and_torque(law: str) -> None:
    arm = robot()
    free = plan(arm, default_line(), START, limits=MotionLimits(*OUR), timing=law)
    need = static(free)
    tight = np.full(6, 500.0)
    tight[2] = 0.98 * need[2]
    refused = plan(arm, default_line(), START, limits=MotionLimits(*OUR, torque=tight), timing=law)
    assert refused.status == "timing_infeasible" and refused.failure is not None
    assert refused.failure.joint == arm.joint_names[2] and 0.0 <= refused.failure.s <= free.joint_path.end
    assert f"{need[2]:.5g}"[:4] in refused.failure.reason and "at any speed" in refused.failure.reason
    tight[2] = 1.1 * need[2]
    assert plan(arm, default_line(), START, limits=MotionLimits(*OUR, torque=tight), timing=law)


def test_two_sides_are_kept_each_by_its_own() -> None:
    arm = robot()
    free = plan(arm, default_line(), START, limits=MotionLimits(*OUR))
    t = np.linspace(0.0, free.trajectory.end, 4001)
    torque = values(arm, free.trajectory, t, arm.loads[0])[:, 0]
    limits = MotionLimits(
        *OUR, torque=(np.minimum(torque.min(axis=0), 0.0) - 2.0, np.maximum(torque.max(axis=0), 0.0) + 2.0)
    )
    proof = certify(arm, default_line(), free.trajectory, limits)
    lower, upper = limits.bounds(6)["torque"]
    friction = COULOMB * np.sign(free.trajectory(t, 1))
    expected = np.maximum((torque + friction) / upper, (torque + friction) / lower).max(axis=0)
    assert (proof.torque.ratio >= expected * (1.0 - 1e-9)).all()
    assert proof.torque.ratio == pytest.approx(expected, abs=2.0 * COULOMB / 2.0)


def test_rows_say_what_the_torque_is_over_its_limit() -> None:
    arm = robot((0.0, 2.0))
    joints = plan(arm, default_line(), START, limits=MotionLimits(*OUR)).joint_path
    limits = MotionLimits(*OUR, torque=60.0, torque_rate=700.0)
    at = PathPoints(joints, np.array([0.4 * joints.end]))
    rng = np.random.default_rng(1)
    rates = (np.abs(rng.normal(size=1)), rng.normal(size=1), rng.normal(size=1))
    for name, columns in (("torque", 4), ("torque_rate", 6)):
        rows = limits.rows(name, at)
        assert rows.shape == (1, 12, columns)
        assert limits.ratios(name, at, rates).shape == (1, 12)
    states = [at.q(0), *apply_chain_rule([at.q(k) for k in (1, 2, 3)], [x[:, None] for x in rates])]
    both = []
    for load in arm.loads:
        out = np.empty((1, 2, 6))
        torques_batch(arm.chain, load.bodies, load.viscous, np.ascontiguousarray(np.stack(states, axis=1)), out)
        both.append(out)
    friction = COULOMB * np.sign(at.q(1))
    torque = np.concatenate([np.abs(out[:, 0] + friction) / 60.0 for out in both], axis=1)
    rate = np.concatenate([np.abs(out[:, 1]) / 700.0 for out in both], axis=1)
    assert limits.ratios("torque", at, rates) == pytest.approx(torque, rel=1e-9)
    assert limits.ratios("torque_rate", at, rates) == pytest.approx(rate, rel=1e-9)
    assert kind_of("torque").rows(at, np.full(6, np.inf)).shape == (1, 1, 4)
    both_sides = PathPoints(joints, np.array([0.0, 0.4 * joints.end]))
    assert (np.abs(limits.rows("torque", both_sides)[0, :, 0]) > np.abs(rows_without(both_sides))[0]).all()


def rows_without(at: PathPoints) -> Array:
    """Rows of s̈ (k, 12) without friction."""
    return np.concatenate([torque_rows(at, load)[:, :, 0] / 60.0 for load in robot((0.0, 2.0)).loads], axis=1)


def test_a_moving_state_is_planned_anew_within_the_torques() -> None:
    arm = robot()
    free = plan(arm, default_line(), START, limits=MotionLimits(*OUR))
    need = static(free)
    limits = MotionLimits(*OUR, torque=need + 0.7 * np.maximum(needed(free, rate=False) - need, 1e-2))
    found = plan(arm, default_line(), START, limits=limits)
    again = replan(found, 0.4 * found.trajectory.end)
    assert again and again.certificate.worst("torque")[0] <= 1.0
    tight = np.full(6, 500.0)
    tight[1] = 0.9 * need[1]
    refused = replan(found, 0.4 * found.trajectory.end, limits=MotionLimits(*OUR, torque=tight))
    assert (
        refused.status == "timing_infeasible"
        and refused.failure is not None
        and "at any speed" in refused.failure.reason
    )


def test_an_arm_without_masses_has_no_torques() -> None:
    bare = replace(paper6r(), inertia=None)
    with pytest.raises(InvalidInput, match="masses"):
        plan(bare, default_line(), START, limits=MotionLimits(*OUR, torque=10.0))
    found = plan(bare, default_line(), START, limits=MotionLimits(*OUR))
    with pytest.raises(InvalidInput, match="masses"):
        certify(bare, default_line(), found.trajectory, MotionLimits(*OUR, torque_rate=10.0))
    assert np.isnan(found.certificate.worst("torque")[0])
    assert MotionLimits.of(bare).torque is None


def test_limits_of_the_robot_come_with_its_masses() -> None:
    panda = optik.load("panda")
    own = MotionLimits.of(panda)
    assert own.torque == pytest.approx(panda.limits.torque)
    assert MotionLimits.of(replace(panda, inertia=None)).torque is None


@pytest.mark.parametrize("suffix", [".json", ".npz", ".csv"])
def test_files_hold_torques_and_those_without_are_as_before(tmp_path: Path, suffix: str) -> None:
    arm = robot()
    limits = MotionLimits(*OUR, torque=np.arange(60.0, 66.0), torque_rate=5000.0)
    motion = plan(arm, default_line(), START, limits=limits, timing="smooth").motion
    file = tmp_path / f"motion{suffix}"
    save(motion, file)
    assert load_motion(file).limits == limits
    assert set(MotionLimits(*OUR).to_plain()) == {"velocity", "acceleration", "jerk", "tool_speed", "rotation_speed"}
    assert MotionLimits.from_plain(MotionLimits(*OUR).to_plain(), 6) == MotionLimits(*OUR)


def test_a_certificate_says_energy_power_and_steps_of_friction() -> None:
    found = plan(robot(), default_line(), START, limits=MotionLimits(*OUR, torque=500.0))
    data = found.certificate.to_dict()
    assert data["energy"]["drawn"] > 0.0 and data["energy"]["power"] > 0.0
    assert len(data["torque"]["value"]) == 6 and data["torque_rate"]["value"] == [None] * 6
    started = [step for step in data["friction_steps"] if step["t"] == 0.0]
    assert {step["size"] for step in started} == {COULOMB}


@pytest.mark.parametrize("law", ["smooth", "ruckig", "constant_speed", "optimal"])
def test_law_and_certificate_of_a_plan_share_one_analysis_of_its_motion(
    law: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    analysed: list[Trajectory] = []
    bounds_of = MotionBounds.__init__

    def count(self: MotionBounds, arm: optik.Robot, trajectory: Trajectory) -> None:
        analysed.append(trajectory)
        bounds_of(self, arm, trajectory)

    monkeypatch.setattr(MotionBounds, "__init__", count)
    limits = MotionLimits(*OUR, torque=200.0, tool_speed=0.3)
    found = plan(robot(), default_line(), START, timing=law, limits=limits)
    assert found, found
    assert sum(motion is found.trajectory for motion in analysed) == 1
    assert len({id(motion) for motion in analysed}) == len(analysed)


def test_a_subclass_of_a_law_with_its_own_motion_is_planned_with_it() -> None:
    class Gentle(Smooth):
        def _time(self, joint_path: JointPath, limits: MotionLimits) -> MotionAnalysis:
            return super()._time(joint_path, limits).stretched(2.0)

    fast, slow = (
        plan(paper6r(), default_line(), START, timing=law, limits=MotionLimits(*OUR)) for law in ("smooth", Gentle())
    )
    assert slow.trajectory.duration == pytest.approx(2.0 * fast.trajectory.duration, rel=1e-12)


def test_an_analysis_of_another_motion_is_refused() -> None:
    motion = plan(paper6r(), default_line(), START, limits=MotionLimits(*OUR)).trajectory
    with pytest.raises(InvalidInput, match=r"^analysis: "):
        certify(paper6r(), default_line(), motion, analysis=MotionAnalysis(paper6r(), motion.stretched(2.0)))
