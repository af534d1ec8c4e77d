"""Settings of batches."""

from __future__ import annotations

from typing import Annotated, ClassVar

from benchmarks.blocks._problems import ProblemBlock
from benchmarks.blocks.ik.batch.measures import MEASURES
from benchmarks.settings import LISTED, Count, Options, SolverName, key
from benchmarks.targets import Measure


class BatchBlock(ProblemBlock):
    """One problem set on one robot, solved as one batch with some numbers of threads."""

    noun = "batch"
    measures: ClassVar[tuple[Measure, ...]] = MEASURES

    solver: SolverName = key("The IK method.")
    solver_options: Options = key("Options of the method.", {})
    threads: Annotated[tuple[Count, ...], LISTED] = key("Numbers of threads, one after another.", (1,))
    repeats: Count = key("Timed repeats of each.", 3)
