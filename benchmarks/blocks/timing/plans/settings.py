"""Settings of the line that is planned by several methods and laws."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from benchmarks.blocks._arms import read_payload
from benchmarks.blocks._scenes import scene_name
from benchmarks.blocks.base import Block
from benchmarks.settings import check_keys, check_known, check_list
from optik.check import check_count, check_number, real_array
from optik.errors import InvalidInput


@dataclass(frozen=True, kw_only=True)
class LineTask(Block):
    """One straight line, planned by some IK methods and time laws.

    Attributes
    ----------
    robot : str
        Name of the arm.
    start_deg : tuple of float
        Where it starts [degrees, mm].
    move_m : tuple of three floats
        From the start of the line to its end, in the base frame [m].
    solvers, laws : tuple of str
        Names of the IK methods and of the time laws.
    samples : int
        Of the path.
    payload : float or pair of floats
        Mass in the tool [kg], or [lightest, heaviest]; by default what the robot's own file states.
    scene : str
        File of what stands around the arm, or a scene of ours (``shelf``, ``table``, ``plates``); empty for none.
    margin : float
        Distance that the arm keeps from the scene [m].
    """

    robot: str
    start_deg: tuple[float, ...]
    move_m: tuple[float, float, float]
    solvers: tuple[str, ...]
    laws: tuple[str, ...]
    samples: int
    payload: float | tuple[float, float] | None = None
    scene: str = ""
    margin: float = 0.0

    @property
    def robots(self) -> tuple[str, ...]:
        """The one arm."""
        return (self.robot,)


def read_task(data: Any) -> LineTask:
    """Check the settings of the line and return it."""
    keys = {"robot", "start_deg", "move_m", "solvers", "laws"}
    check_keys(data, keys | {"samples", "payload", "scene", "margin"}, "the line", need=keys)
    robot = check_known(data["robot"], "optik.robots", "robot")
    methods = tuple(
        check_known(name, "optik.ik", "IK method") for name in check_list(data["solvers"], "the line: solvers")
    )
    laws = tuple(
        check_known(name, "planners.timing", "time law") for name in check_list(data["laws"], "the line: laws")
    )
    check_count(data.get("samples", 151), "the line: samples", 2)
    move = real_array(data["move_m"], "the line: move_m", "three numbers [m]")
    if move.shape != (3,):
        raise InvalidInput("the line: move_m", data["move_m"], "three numbers [m]")
    return LineTask(
        id="line",
        title="the line",
        robot=robot,
        start_deg=tuple(data["start_deg"]),
        move_m=tuple(data["move_m"]),
        solvers=methods,
        laws=laws,
        samples=int(data.get("samples", 151)),
        payload=read_payload(data.get("payload"), "the line: payload"),
        scene=scene_name(data["scene"], "the line: scene") if "scene" in data else "",
        margin=check_number(data.get("margin", 0.0), "the line: margin", "metres, 0 or more", least=0.0),
    )
