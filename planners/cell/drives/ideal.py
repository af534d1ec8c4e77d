"""IdealDrive: an arm that follows its set-points exactly; only its encoders have a resolution."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from optik.types import Array, Flags
from planners.cell.drives._run import Commands, Steps
from planners.cell.drives._simulated import SimulatedDrive


class IdealDrive(SimulatedDrive):
    """An arm without mass, which follows the interpolated set-points exactly. It has the options of every simulated drive.

    A joint that was blocked for a moment catches up with its set-points at its velocity limit. A joint whose fault stopped
    the arm does not move any more.
    """

    name: ClassVar[str] = "ideal"

    def _place(self, q: Array) -> None:
        self._q = q.copy()
        self._behind = np.zeros(self.robot.n, dtype=bool)

    def _actual(self) -> Array:
        return self._q.copy()

    def _advance(self, commands: Commands, stalled: Flags) -> Steps:
        self._behind |= stalled
        stalled = stalled | (self._behind & (np.arange(self.robot.n) == self._stuck))
        if not self._behind.any():
            self._q = commands.q[-1].copy()
            return Steps(commands.q[1:], commands.dq[1:])
        known = self.robot.limits.velocity
        most = np.inf if known is None else np.asarray(known) * (commands.t[1] - commands.t[0])
        q, dq = np.empty_like(commands.q[1:]), commands.dq[1:].copy()
        for i, (aim, h) in enumerate(zip(commands.q[1:], np.diff(commands.t), strict=True)):
            step = np.where(stalled, 0.0, np.clip(aim - self._q, -most, most))
            reached = self._behind & ~stalled & (np.abs(aim - self._q) <= most)
            q[i] = np.where(self._behind, self._q + step, aim)
            dq[i] = np.where(self._behind, step / h, dq[i])
            self._behind &= ~reached
            self._q = q[i]
        return Steps(q, dq)


METHOD = IdealDrive
