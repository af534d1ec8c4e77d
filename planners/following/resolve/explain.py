"""Why no configuration goes on at a place of a path, and the failure of the whole path."""

from __future__ import annotations

from dataclasses import replace

from optik.arm.reach import outside_reach, reach_bound
from optik.task import POSE
from planners.following.failure import FollowStatus, PlanFailure
from planners.following.resolve import Resolution
from planners.following.resolve.nodes import Sampler
from planners.paths.base import Path

DRAWS = 200
"""Random guesses by which a place is explained."""


def explain_stuck(sampler: Sampler, path: Path, made: Resolution, before: PlanFailure) -> PlanFailure:
    """Return the failure of following one way, with why no other configuration goes on, either.

    A place that is merely not reached by any guess is not called unreachable.
    """
    if made.stuck is None:
        return before
    a, b = made.stuck
    pose, robot = path.pose(b), sampler.arm
    found = sampler.draw(pose[None], DRAWS)[0]
    touching = found[sampler.rooms(found) <= 0.0]
    if not len(found):
        why = f"no configuration inside the limits was found at s = {b:.6g} from {DRAWS} random guesses"
    elif len(touching) == len(found):
        pair = sampler.name_contact(touching)
        why = f"all {len(found)} configurations that were found at s = {b:.6g} are in contact, mostly {pair}"
    else:
        kept = len(found) - len(touching)
        why = f"none of the {kept} configurations that were found at s = {b:.6g} continues one before it"
    proved = outside_reach(reach_bound(robot, POSE), pose, 0.0, 0.0) >= 0.0
    status = before.status
    if status == FollowStatus.UNREACHABLE and not proved:
        status = FollowStatus.NO_PATH_FOUND
    reason = f"{before.reason}; between s = {a:.6g} and {b:.6g} {path.unit} no other goes on: {why}"
    return replace(before, status=status, reason=reason)
