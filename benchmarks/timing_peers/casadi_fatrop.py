"""The programme one writes oneself, stage by stage for fatrop, every option left as it is."""

from __future__ import annotations

from typing import Any, ClassVar

from benchmarks.timing_peers._casadi_programme import PLACES, CasadiProgramme


class CasadiFatrop(CasadiProgramme):
    """``nlpsol("timing", "fatrop", …)`` with the structure that it detects; only its printing is off."""

    solver = "fatrop"
    options: ClassVar[dict[str, Any]] = {
        "print_time": False, "structure_detection": "auto", "fatrop": {"print_level": 0},
    }  # fmt: skip
    settings = (
        f"nlpsol with fatrop, structure detected: states ṡ and s̈ at {PLACES + 1} fixed places, free time steps, constant s⃛ "
        "between; limits at the places; from a quintic rest-to-rest motion; every option left as it is"
    )


METHOD = CasadiFatrop
