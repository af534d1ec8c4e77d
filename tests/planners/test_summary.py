"""print(plan), print(certificate), print(result): at most fifteen short lines, the status first, three digits and a unit."""

import re
from typing import Any

import numpy as np
import pytest

import optik
import planners
from optik.scene import Scene

ARM, PANDA = optik.load("paper6r"), optik.load("panda")
START = np.deg2rad([20, -35, 40, 25, 50, -30])


def moved(arm: optik.Robot, q: Any, *by: float) -> Any:
    goal = arm.fk(q).copy()
    goal[:3, 3] += by
    return goal


def short(text: str) -> list[str]:
    lines = text.splitlines()
    assert 2 <= len(lines) <= 15
    assert max(map(len, lines)) < 330
    return lines


def plans() -> dict[str, planners.Plan]:
    middle = PANDA.limits.middle
    tight = planners.MotionLimits(velocity=1.0, acceleration=5.0, jerk=50.0, tool_speed=0.2, torque=0.5)
    return {
        "solved": planners.plan(ARM, moved(ARM, START, -0.12, 0.0, 0.2), START),
        "outside_limits": planners.plan(ARM, moved(ARM, START, 0.0, 0.0, 2.0), START),
        "timing_infeasible": planners.plan(ARM, moved(ARM, START, -0.12, 0.0, 0.2), START, limits=tight),
        "contact": planners.plan(PANDA, moved(PANDA, middle, 0.05, 0.1, -0.2), middle, scene=Scene()),
    }


@pytest.fixture(scope="module")
def made() -> dict[str, planners.Plan]:
    return plans()


def test_a_plan_prints_its_status_its_certificate_or_its_reason(made: dict[str, planners.Plan]) -> None:
    for plan in made.values():
        lines = short(str(plan))
        assert lines[0].startswith(f"{plan.status}: {plan.robot.name}, Line of ")
        if plan.failure is None:
            proof = str(plan.certificate).splitlines()
            assert lines[1 : len(proof) + 1] == proof and lines[len(proof) + 1].startswith("limited by ")
        else:
            assert f"reason: {plan.failure.reason}" in lines
            assert f"try: {plan.failure.advice}" in lines
    assert {str(plan.status) for plan in made.values()} >= {"solved", "outside_limits", "timing_infeasible"}


def test_a_certificate_prints_its_validity_and_every_peak(made: dict[str, planners.Plan]) -> None:
    proof = made["solved"].certificate
    lines = short(str(proof))
    assert lines[0].startswith("certificate valid")
    ratio, joint, t = proof.worst("velocity")
    assert f"peak / limit, velocity: {ratio:.3g} ({joint} at {t:.3g} s)" in lines
    low = planners.certify(ARM, None, made["solved"].trajectory, planners.MotionLimits(velocity=0.5))
    assert not low.is_valid
    assert "path error" not in str(low)
    for fields, more in ((1, ""), (2, " (and 1 more violation)"), (3, " (and 2 more violations)")):
        tight = dict(list({"velocity": 0.5, "acceleration": 0.1, "jerk": 0.1}.items())[:fields])
        low = planners.certify(ARM, None, made["solved"].trajectory, planners.MotionLimits(**tight))
        assert len(low.reasons) == fields
        assert short(str(low))[0] == f"certificate NOT valid: {low.reasons[0]}{more}"


def test_of_many_limits_those_with_the_largest_ratios_are_printed(
    made: dict[str, planners.Plan], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("planners.certificate.certificate.MOST_LIMITS", 1)
    limits = planners.MotionLimits(velocity=50.0, acceleration=100.0, jerk=1.0)
    (line,) = (x for x in short(str(planners.certify(ARM, None, made["solved"].trajectory, limits))) if "peak" in x)
    assert line.startswith("peak / limit, jerk: ") and line.endswith("; 2 more limits with smaller ratios")


def test_a_plan_says_what_limits_it_for_how_much_of_the_time(made: dict[str, planners.Plan]) -> None:
    plan = made["solved"]
    (said,) = (line for line in str(plan).splitlines() if line.startswith("limited by "))
    t = np.linspace(0.0, plan.duration, 20_001)
    limits = ((name, plan.limits.arrays(ARM.n)[name]) for name in ("velocity", "acceleration", "jerk"))
    ratios = np.concatenate([np.abs(plan.trajectory(t, k)) / limit for k, (_, limit) in enumerate(limits, 1)], axis=1)
    names = [f"{name} of {joint}" for name in ("velocity", "acceleration", "jerk") for joint in ARM.joint_names]
    for words, percent in re.findall(r"(\S+ of \S+) for (\d+) %", said):
        at_limit = ratios[:, names.index(words)] > 0.985
        assert 100.0 * at_limit.mean() >= int(percent) - 2, "a segment between knots is at its limit somewhere"
    assert 0 < sum(map(int, re.findall(r"(\d+) %", said))) <= 101
    assert not any("limited by" in str(plan) for plan in made.values() if not plan)


def test_figures_have_three_digits(made: dict[str, planners.Plan]) -> None:
    for plan in made.values():
        ours = [line for line in str(plan).splitlines() if not line.startswith(("reason", "try"))]
        assert not re.search(r"\d\.\d{4}", re.sub(r"0\.(999+|0*)", "0.", "\n".join(ours)))


def test_an_answer_of_inverse_kinematics_prints_its_status_first() -> None:
    solved = optik.solve_ik(ARM, ARM.fk(START), START + 0.1)
    lines = short(str(solved))
    assert lines[0].startswith("solved: ")
    assert f"{solved.q[0]:.3g}" in lines[1]
    assert len(lines) == 3
    failed = optik.solve_ik(ARM, moved(ARM, START, 0.0, 0.0, 2.2), START, max_restarts=2)
    lines = short(str(failed))
    assert lines[0].startswith("unreachable: ")
    assert lines[-1] == f"try: {failed.status.advice}"
    batch = optik.solve_ik_batch(ARM, np.stack([ARM.fk(START), moved(ARM, START, 0, 0, 2.2)]), np.stack([START, START]))
    assert str(batch) == "1 of 2 solved: 1 unreachable"
