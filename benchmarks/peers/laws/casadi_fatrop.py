"""Minimum-time nonlinear programme by fatrop with default options, ordered by stages."""

from __future__ import annotations

from typing import Any, ClassVar

from benchmarks.peers.laws._casadi_programme import NLP_INTERVALS, NLP_ITERATIONS, CasadiProgramme


class CasadiFatrop(CasadiProgramme):
    """``nlpsol("timing", "fatrop", …)`` with automatic structure detection and without output."""

    solver = "fatrop"
    options: ClassVar[dict[str, Any]] = {
        "print_time": False, "expand": True, "structure_detection": "auto",
        "fatrop": {"print_level": 0, "max_iter": NLP_ITERATIONS},
    }  # fmt: skip
    settings = (
        f"nlpsol with fatrop, structure detected: states ṡ and s̈ at {NLP_INTERVALS + 1} fixed nodes, free time steps, "
        "constant s⃛ between; limits at the nodes; initial guess a quintic motion from rest to rest; "
        f"expanded to scalar operations; at most {NLP_ITERATIONS} iterations, otherwise default options"
    )


METHOD = CasadiFatrop
