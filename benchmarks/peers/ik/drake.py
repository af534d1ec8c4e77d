"""Drake: the nonlinear programme of its InverseKinematics class, solved by SNOPT."""

from __future__ import annotations

from typing import ClassVar

from benchmarks.peers.ik.base import WorkerSolver


class Drake(WorkerSolver):
    """The method of ``benchmarks/peers/_workers/drake.py``."""

    environment = "drake"
    distribution = "drake"
    package = "pydrake"
    requirements: ClassVar[tuple[str, ...]] = ("drake==1.51.1", "pyroboplan==1.3.1")
    settings = (
        "InverseKinematics built and solved for each target: six equalities by AddPositionConstraint on three points of the "
        "tool, limits as bounds, SNOPT from the start, feasibility tolerance 1e-9 (with its default of 1e-6 and "
        "AddOrientationConstraint 1 % of near targets are met within 1e-6, so 100 %; IPOPT solves 45 % instead of 31 % cold in "
        "ten times the time); no restarts; in a worker process, whose times leave out the pipe"
    )


METHOD = Drake
