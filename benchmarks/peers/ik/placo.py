"""placo (Rhoban): a frame task by quadratic programmes in C++, as a loop to convergence."""

from __future__ import annotations

from typing import ClassVar

from benchmarks.peers.ik.base import WorkerSolver


class Placo(WorkerSolver):
    """The method of ``benchmarks/peers/_workers/placo.py``."""

    environment = "placo"
    distribution = "placo"
    package = "placo"
    requirements: ClassVar[tuple[str, ...]] = ("placo==0.10.2",)
    settings = (
        "KinematicsSolver with joint limits and one frame task (soft, weights 1), solve(True) and update_kinematics in a "
        "Python loop at most 100 times until position and rotation error are < 7e-7; no restarts; in a worker process, since "
        "it needs another version of Pinocchio; times are taken there, without the pipe"
    )


METHOD = Placo
