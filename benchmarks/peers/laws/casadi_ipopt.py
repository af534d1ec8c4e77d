"""The programme one writes oneself, by IPOPT as it comes."""

from __future__ import annotations

from typing import Any, ClassVar

from benchmarks.peers.laws._casadi_programme import ITERATIONS, PLACES, CasadiProgramme


class CasadiIPOPT(CasadiProgramme):
    """``nlpsol("timing", "ipopt", …)``; only its printing is off."""

    solver = "ipopt"
    options: ClassVar[dict[str, Any]] = {
        "print_time": False,
        "ipopt": {"print_level": 0, "sb": "yes", "max_iter": ITERATIONS},
    }
    settings = (
        f"nlpsol with ipopt: states ṡ and s̈ at {PLACES + 1} fixed places, free time steps, constant s⃛ between; limits at "
        f"the places; from a quintic rest-to-rest motion; at most {ITERATIONS} iterations, every other option left as it is"
    )


METHOD = CasadiIPOPT
