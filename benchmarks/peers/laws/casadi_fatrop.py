"""The programme one writes oneself, stage by stage for fatrop, as it comes."""

from __future__ import annotations

from typing import Any, ClassVar

from benchmarks.peers.laws._casadi_programme import ITERATIONS, PLACES, CasadiProgramme


class CasadiFatrop(CasadiProgramme):
    """``nlpsol("timing", "fatrop", …)`` with the structure that it detects; only its printing is off."""

    solver = "fatrop"
    options: ClassVar[dict[str, Any]] = {
        "print_time": False, "structure_detection": "auto", "fatrop": {"print_level": 0, "max_iter": ITERATIONS},
    }  # fmt: skip
    settings = (
        f"nlpsol with fatrop, structure detected: states ṡ and s̈ at {PLACES + 1} fixed places, free time steps, constant s⃛ "
        "between; limits at the places; from a quintic rest-to-rest motion; "
        f"at most {ITERATIONS} iterations, every other option left as it is"
    )


METHOD = CasadiFatrop
