"""The cell of docs/cell.md and its four drawings; ``make drawings`` writes the files."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import optik
from docs.drawings.frames import draw_frames
from docs.drawings.layers import draw_layers
from docs.drawings.setting import draw_setting
from docs.drawings.workflow import draw_workflow
from planners.cell import Cell, Gripper, PanTiltLaser, Plane

ROBOT = optik.load("paper6r")
START = np.deg2rad([20.0, -35.0, 40.0, 25.0, 50.0, -30.0])
"""Configuration at the start of the default line [rad]."""

SPOT = ROBOT.fk(START)[:3, 3] + [-0.12, 0.0, 0.20]
"""End of the default line [m]."""

POSE = np.array([[1.0, 0.0, 0.0, -0.55], [0.0, 0.0, -1.0, -0.1], [0.0, 1.0, 0.0, 0.15], [0.0, 0.0, 0.0, 1.0]])
"""Pose of the laser unit, upright beside the arm; up is −y."""

LASER = PanTiltLaser(
    POSE,
    pan_limits=(-np.pi / 2, np.pi / 2),
    tilt_limits=(-np.pi / 3, np.pi / 3),
    range_limits=(0.05, 10.0),
    angle_noise=2e-4,
    range_noise=1e-3,
    pose_covariance=np.diag([3e-4, 3e-4, 3e-4, 2e-4, 2e-4, 2e-4]) ** 2,
)
PAPER = Plane(SPOT, np.array([0.0, -1.0, 0.0]))
"""The graph paper, on the table."""

GRIPPER = Gripper(optik.se3.pose(p=[0.0, 0.0, 0.1]), opening=0.06, mass=0.4)


def cell() -> Cell:
    """Return the cell of the page."""
    return Cell(ROBOT, LASER, "ideal", gripper=GRIPPER, q=START)


def drawings() -> dict[str, str]:
    """Return the drawings: SVG texts by the names of their files."""
    loop = cell()
    spot = loop.read(SPOT)
    moving = cell()
    aside = np.add(SPOT, [0.03, 0.0, 0.0])
    workflow = draw_workflow(
        [loop.open(), loop.move_to_spot(spot, corrections=1), loop.close(0.02)],
        moving.move_to_spot(spot, follow=lambda t: LASER.reading(SPOT if t < 0.1 else aside)),
    )
    pan, tilt, _ = LASER.reading(SPOT)
    return {
        "cell-layers.svg": draw_layers(cell()),
        "cell-workflow.svg": workflow,
        "cell-frames.svg": draw_frames(ROBOT),
        "cell-setting.svg": draw_setting(ROBOT, LASER, PAPER, float(pan), float(tilt), START),
    }


if __name__ == "__main__":
    for name, text in drawings().items():
        (Path(__file__).parents[1] / name).write_text(text, encoding="utf-8")
