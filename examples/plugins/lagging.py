"""A drive in one file: an arm whose joints lag behind their set-points. Run this script, or use its path as a drive.

python examples/plugins/lagging.py
drive = planners.cell.make_drive("./lagging.py", robot)
"""

import numpy as np

from planners.cell import SimulatedDrive
from planners.cell.drives import Steps


class Lagging(SimulatedDrive):
    """Every joint approaches its set-point with one time constant."""

    lag = 0.002  # [s]
    settling = 0.05  # [s]: how long the last set-point is held

    def _place(self, q):
        self._q = q.copy()

    def _actual(self):
        return self._q.copy()

    def _advance(self, commands, stalled):
        """Return the arm's state after each plant step of one period. `commands` has m + 1 set-points."""
        q = np.empty_like(commands.q[1:])
        for i, h in enumerate(np.diff(commands.t)):
            fraction = np.where(stalled, 0.0, -np.expm1(-h / self.lag))
            self._q = q[i] = self._q + fraction * (commands.q[i + 1] - self._q)
        dq = np.diff(q, axis=0, prepend=q[:1]) / h
        return Steps(q, dq)


METHOD = Lagging


if __name__ == "__main__":
    import optik
    import planners

    robot = optik.load("paper6r")
    q = np.deg2rad([20.0, -35.0, 40.0, 25.0, 50.0, -30.0])
    target = robot.fk(q)
    target[:3, 3] += [-0.12, 0.0, 0.20]
    plan = planners.plan(robot, target, q)
    execution = Lagging(robot).execute(plan)
    late = np.abs(execution.q - execution.motion(np.minimum(execution.t, execution.motion.end))).max()
    print(f"{execution.status}: {execution.t[-1]:.3f} s, up to {late:.2g} rad behind")
