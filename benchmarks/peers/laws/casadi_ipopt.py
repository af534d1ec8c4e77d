"""Minimum-time nonlinear programme by IPOPT with default options."""

from __future__ import annotations

from typing import Any, ClassVar

from benchmarks.peers.laws._casadi_programme import NLP_INTERVALS, NLP_ITERATIONS, CasadiProgramme


class CasadiIPOPT(CasadiProgramme):
    """``nlpsol("timing", "ipopt", …)`` without output."""

    solver = "ipopt"
    options: ClassVar[dict[str, Any]] = {
        "print_time": False,
        "expand": True,
        "ipopt": {"print_level": 0, "sb": "yes", "max_iter": NLP_ITERATIONS},
    }
    settings = (
        f"nlpsol with ipopt: states ṡ and s̈ at {NLP_INTERVALS + 1} fixed nodes, free time steps, constant s⃛ between; limits at "
        f"the nodes; initial guess a quintic motion from rest to rest; expanded to scalar operations; at most {NLP_ITERATIONS} "
        "iterations, otherwise default options"
    )


METHOD = CasadiIPOPT
