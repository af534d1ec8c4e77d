"""Settings of the line that is planned by several methods and laws."""

from __future__ import annotations

from typing import Annotated

from benchmarks.blocks._arms import Payload
from benchmarks.blocks._scenes import SceneName
from benchmarks.blocks.base import Block
from benchmarks.settings import LISTED, Joints, LawName, RobotName, SolverName, Three, counted, key, numbered


class LineTask(Block):
    """One straight line, planned by some IK methods and time laws."""

    noun = "the line"
    fixed = frozenset({"id", "title", "targets"})

    id: str = "line"
    title: str = "the line"
    robot: RobotName = key("The arm.")
    start_deg: Joints = key("Start configuration.", unit="degrees, mm")
    move_m: Three = key("From the start of the line to its end, in the base frame.", unit="m")
    solvers: Annotated[tuple[SolverName, ...], LISTED] = key("IK methods.")
    laws: Annotated[tuple[LawName, ...], LISTED] = key("Time laws.")
    samples: Annotated[int, counted(2)] = key("Samples of the path.", 151)
    payload: Payload = key("Mass in the tool, or [lightest, heaviest]; by default that of the robot file.", None, "kg")
    scene: SceneName = key("Scene: `shelf`, `table`, `plates`, or a file; by default none.", "")
    margin: Annotated[float, numbered("metres, 0 or more", least=0.0)] = key(
        "Least distance between arm and scene.", 0.0, "m"
    )
