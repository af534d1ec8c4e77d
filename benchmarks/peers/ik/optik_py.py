"""OptIK (optik-py, by Kyle Cesare): a Rust solver with analytical gradients and random restarts."""

from __future__ import annotations

from typing import ClassVar

from benchmarks.peers.ik.base import WorkerSolver


class OptikPy(WorkerSolver):
    """The method of ``benchmarks/peers/_workers/optik_py.py``."""

    environment = "optik_py"
    distribution = "optik-py"
    package = "optik"
    requirements: ClassVar[tuple[str, ...]] = ("optik-py==0.5.0",)
    budgeted = False
    clocked = True
    random = True
    settings = (
        "Robot.ik in Speed mode, max_time 0.1 s, tol_f 1e-13 (on half the squared error; its default of 1e-6 reaches "
        "1e-3 m, not 1e-6), one thread (the default races one restart a core); in a worker process, since its import "
        "name is ours; times are taken there, without the pipe"
    )


METHOD = OptikPy
