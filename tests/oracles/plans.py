"""Oracle of whole plans: slow, plain NumPy over a motion's coefficients and a robot's tables; says what is contradicted."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from optik.arm.limits import LIMIT_TOLERANCE
from planners import Plan
from tests.oracles.kinematics import fk, smallest, speeds
from tests.oracles.motions import Joints, piece_values
from tests.oracles.paths import nearest
from tests.oracles.pinocchio import PinocchioDynamics
from tests.oracles.poses import off_by

Array = Any

DERIVATIVES = ("velocity", "acceleration", "jerk")
ROUNDING = 1e-11
"""Share of the largest value that Horner's rule in another order may differ by."""
CHUNK = 200_000
TORQUES = 400
"""Instants at which torques are computed: Pinocchio takes them one by one."""


def contradictions(plan: Plan, q_start: Array | None, rate: float, most: int, seed: int = 0) -> list[str]:
    """What of a solved plan and its certificate is not so, looked at so often a second, or so many times at most."""
    rng = np.random.default_rng(seed)
    joints = Joints(plan.trajectory)
    end = joints.t[-1]
    count = int(min(max(end * rate, 2000.0), most))
    t = np.clip((np.arange(count) + rng.random()) * end / count, 0.0, end)  # a random phase
    words = [*_ends(plan, joints, q_start), *_continuity(plan, joints)]
    for chunk in np.array_split(t, max(1, count // CHUNK)):
        words += joint_extremes(plan, joints, chunk)
        words += tool_speeds(plan, joints, chunk)
    words += _at_the_times_said(plan, joints)
    words += _singular(plan, joints, t[:: max(1, count // 4000)])
    words += _on_the_path(plan, joints, np.sort(rng.choice(t, min(count, most // 40), replace=False)))
    words += _verdict(plan, joints, t)
    return list(dict.fromkeys(words))


def _ends(plan: Plan, joints: Joints, q_start: Array | None) -> Iterator[str]:
    robot, path = plan.robot, plan.path
    first, last = joints.ends(0)[0][0], joints.ends(0)[1][-1]
    if q_start is not None and np.abs(first - q_start).max() > 1e-9:
        yield f"starts {np.abs(first - q_start).max():.3g} from q_start"
    for q, s, name in ((first, 0.0, "starts"), (last, path.end, "ends")):
        distance, angle = off_by(fk(robot, q[None]), path.pose(np.array([s])))
        if max(distance[0], angle[0]) > 1e-9:
            yield f"{name} {distance[0]:.3g} m and {angle[0]:.3g} rad off the path's own"
    begin, finish = joints.ends(1)
    fast = np.abs(joints(np.linspace(0.0, joints.t[-1], 999), 1)).max()
    for v, name in ((begin[0], "start"), (finish[-1], "end")):
        if np.abs(v).max() > 1e-9 * max(fast, 1e-12) * 2.0:
            yield f"no rest at the {name}: {np.abs(v).max():.3g} of {fast:.3g}"
    if plan.certificate.rest != (True, True):
        yield f"the certificate says rest {plan.certificate.rest}"
    knots = plan.joint_path.knots
    distance, angle = off_by(fk(robot, plan.joint_path.q), path.pose(knots))
    if max(distance.max(), angle.max()) > 1e-9:
        yield f"joint path {distance.max():.3g} m and {angle.max():.3g} rad off at its knots"


def _continuity(plan: Plan, joints: Joints) -> Iterator[str]:
    said = plan.certificate.continuous
    inside = (joints.t[:-1, None] + np.diff(joints.t)[:, None] * np.linspace(0.0, 1.0, 9)).ravel()
    if said < 1:
        yield f"only C{said}"
    for order in range(4):
        first, last = joints.ends(order)
        scale = max(np.abs(joints(inside, order)).max(), np.abs(first).max())
        step = np.abs(first[1:] - last[:-1]).max(initial=0.0)
        if order:
            step = max(step, np.abs(first[0]).max(), np.abs(last[-1]).max())
        if order <= said and step > 2e-5 * scale:
            yield f"said to be C{said}, but order {order} jumps by {step:.3g} of {scale:.3g}"
        if order == said + 1 and step < 0.5e-5 * scale:
            yield f"said to be C{said}, but order {order} jumps by {step:.3g} of {scale:.3g} only"


def joint_extremes(plan: Plan, joints: Joints, t: Array) -> Iterator[str]:
    proof, robot = plan.certificate, plan.robot
    q = joints(t)
    room = np.minimum(q - robot.limits.lower, robot.limits.upper - q).min(axis=0)
    if (room < proof.position_margin - 1e-12 * (1.0 + np.abs(q).max())).any():
        yield f"position margin {proof.position_margin} but room {room}"
    i = np.clip(np.searchsorted(joints.t, t, side="right") - 1, 0, len(joints.t) - 2)
    ratio = np.zeros(len(t))
    for order, field in enumerate(DERIVATIVES, start=1):
        said = getattr(proof, field).value
        values = np.abs(joints(t, order))
        found = values.max(axis=0)
        with np.errstate(invalid="ignore"):
            if (found > said + ROUNDING * found.max() + 1e-14).any():
                yield f"{field} found {found} above the certificate's {said}"
        ratio = np.maximum(ratio, (values / plan.limits.arrays(robot.n)[field]).max(axis=1))
    if (ratio > proof.binding.ratio[i] * (1.0 + 1e-9) + 1e-9).any():
        k = int((ratio - proof.binding.ratio[i]).argmax())
        yield f"binding ratio {proof.binding.ratio[i[k]]:.9g} of piece {i[k]} but {ratio[k]:.9g} in it"


def _at_the_times_said(plan: Plan, joints: Joints) -> Iterator[str]:
    """Exact values are reached at the instants that the certificate names, on one side at least."""
    proof, n = plan.certificate, plan.robot.n
    for order, field in enumerate(DERIVATIVES, start=1):
        extreme = getattr(proof, field)
        bound = plan.limits.arrays(n)[field]
        for j in np.flatnonzero(np.isfinite(extreme.value)):
            at = extreme.time[j]
            near = np.array([np.nextafter(at, -1.0), at, np.nextafter(at, np.inf)])
            k = np.clip(np.searchsorted(joints.t, near, side="right") - 1, 0, len(joints.t) - 2)
            k = np.unique(np.clip(np.concatenate([k - 1, k]), 0, len(joints.t) - 2))
            k = k[(joints.t[k] <= at + 1e-12) & (joints.t[k + 1] >= at - 1e-12)]
            found = np.abs(piece_values(joints.c[:, k], at - joints.t[k], order)[:, j]).max()
            largest = float(np.max(extreme.value[np.isfinite(extreme.value)]))
            if abs(found - extreme.value[j]) > 1e-8 * largest + 1e-14:
                yield f"{field} of joint {j} is {found:.9g} at t = {at:.9g}, not {extreme.value[j]:.9g}"
            if np.isfinite(bound[j]) and not np.isclose(extreme.ratio[j], extreme.value[j] / bound[j], rtol=1e-12):
                yield f"{field} of joint {j}: ratio {extreme.ratio[j]} of {extreme.value[j]} over {bound[j]}"
    room = proof.position_margin.min()
    if proof.is_valid and room < -LIMIT_TOLERANCE:
        yield f"holds with a margin of {room}"


def tool_speeds(plan: Plan, joints: Joints, t: Array) -> Iterator[str]:
    largest = speeds(plan.robot, joints, t).max(axis=0)
    for part, field in enumerate(("tool_speed", "rotation_speed")):
        said, found = getattr(plan.certificate, field), float(largest[part])
        if found > said.value * (1.0 + ROUNDING) + 1e-13:
            yield f"{field} {found:.9g} above the bound {said.value:.9g}"
        at = float(speeds(plan.robot, joints, np.array([said.time]))[0, part])
        if said.value > at * (1.0 + 1e-5) + 1e-5:
            yield f"{field} bound {said.value:.9g}, but {at:.9g} where it is nearly reached"


def _singular(plan: Plan, joints: Joints, t: Array) -> Iterator[str]:
    proof = plan.certificate
    at = float(smallest(plan.robot, joints(np.array([proof.t_singular_value])))[0])
    if abs(at - proof.singular_value) > 1e-9:
        yield f"singular value {proof.singular_value:.9g} said, {at:.9g} there"
    values = smallest(plan.robot, joints(t))
    k = int(values.argmin())
    # a dip between two of its 201 instants is not seen: no more than the value changes over half of such a step
    slope = float(np.abs(np.diff(values) / np.diff(t)).max())
    if proof.singular_value > values[k] + min(slope * joints.t[-1] / 400.0, 0.02) + 1e-9:
        yield f"singular value {values[k]:.9g} at t = {t[k]:.6g}, below the certificate's {proof.singular_value:.9g}"


def _on_the_path(plan: Plan, joints: Joints, t: Array) -> Iterator[str]:
    """At each instant some place near the one expected has both the distance and the angle within the bounds."""
    proof, path = plan.certificate, plan.path
    at, off = proof.binding, proof.path_error
    if not (np.diff(at.s) >= -1e-7 * path.end).all():
        yield f"places run backwards by {-np.diff(at.s).min():.3g}"
    if at.s[0] > 1e-7 * path.end or at.s[-1] < (1.0 - 1e-7) * path.end:
        yield f"places from {at.s[0]:.9g} to {at.s[-1]:.9g} of {path.end:.9g}"
    i = np.clip(np.searchsorted(at.t, t, side="right") - 1, 0, len(at.t) - 2)
    margin = 1e-3 * path.end
    low = np.clip(np.minimum(at.s[i], at.s[i + 1]) - margin, 0.0, path.end)
    high = np.clip(np.maximum(at.s[i], at.s[i + 1]) + margin, 0.0, path.end)
    q = joints(t)
    T = fk(plan.robot, q)
    for weight in (0.0, 1.0, off.distance / off.angle):
        s, cost = nearest(path, T, low, high, weight)
        # where both bounds hold at one place, the least of any weighted sum is within that of the bounds
        k = int(cost.argmax())
        if cost[k] > np.hypot(off.distance, weight * off.angle) + 1e-12 + 1e-14 * np.abs(T).max():
            yield f"off the path by {cost[k]:.6g} (weight {weight:.3g}) at t = {t[k]:.9g}: bounds {off[:2]}"
    away = np.abs(q - plan.joint_path(s)).max(axis=1)
    allowed = 1e-6 + 20.0 * (off.distance + off.angle) / np.maximum(smallest(plan.robot, q), 1e-4)
    if path.configurations(plan.robot, np.zeros(1)) is None and (away > allowed).any():
        k = int((away / allowed).argmax())
        yield f"joints {away[k]:.3g} from the joint path at s = {s[k]:.6g}, t = {t[k]:.6g} (allowed {allowed[k]:.3g})"


def _torques(plan: Plan, joints: Joints, t: Array) -> dict[str, float]:
    """Largest torques and rates over their limits, for the limits that there are."""
    bound, found = plan.limits.bounds(plan.robot.n), {"torque": 0.0, "torque_rate": 0.0}
    if np.isinf(bound["torque"]).all() and np.isinf(bound["torque_rate"]).all():
        return found
    other = PinocchioDynamics(plan.robot)
    for state in zip(*(joints(t, order) for order in range(4)), strict=True):
        values = {"torque": other.torques(*state[:3]), "torque_rate": other.rates(*state)}
        found = {f: max(found[f], float((np.abs(x) / bound[f]).max())) for f, x in values.items()}
    return found


def _verdict(plan: Plan, joints: Joints, t: Array) -> Iterator[str]:
    """`is_valid` against what is found for the law's promises."""
    proof, robot = plan.certificate, plan.robot
    worst = {f: 0.0 for f in ("velocity", "acceleration", "jerk", "tool_speed", "rotation_speed")}
    worst |= _torques(plan, joints, t[:: max(1, len(t) // TORQUES)])
    bound = plan.limits.arrays(robot.n)
    for order, field in enumerate(DERIVATIVES, start=1):
        sided = np.concatenate([np.abs(joints(t, order)), *(np.abs(x) for x in joints.ends(order))])
        worst[field] = float((sided / bound[field]).max())
    largest = speeds(plan.robot, joints, t[:: max(1, len(t) // CHUNK)]).max(axis=0)
    worst |= zip(("tool_speed", "rotation_speed"), (largest / plan.limits.tool).tolist(), strict=True)
    kept = {f: worst[f] for f in proof.enforced}
    if proof.is_valid and any(x > 1.0 + 1e-9 for x in kept.values()):
        yield f"holds, but {kept}"
    if not proof.is_valid and all(x < 1.0 - 1e-3 for x in kept.values()) and proof.tolerance is not None:
        off = proof.path_error
        on_path = off.distance <= proof.tolerance.position and off.angle <= proof.tolerance.rotation
        if on_path and proof.position_margin.min() >= 0:
            yield f"does not hold ({proof.reasons}), but {kept}"
    if plan.law != "quintic" and not proof.is_valid:
        yield f"a law that promises, and does not hold: {proof.reasons}"
