"""Settings of blocks of single calls."""

from __future__ import annotations

from typing import Annotated, ClassVar

from pydantic import AfterValidator

from benchmarks.blocks._entries import IKPeer, Method
from benchmarks.blocks._problems import ProblemBlock
from benchmarks.blocks.base import Entry
from benchmarks.blocks.ik.calls.measures import MEASURES
from benchmarks.settings import LISTED, Count, Entries, check_different, key
from benchmarks.targets import Measure


def _sorted(counts: tuple[int, ...]) -> tuple[int, ...]:
    check_different([str(count) for count in counts], "", "number")
    return tuple(sorted(counts))


class CallBlock(ProblemBlock):
    """One problem set on one robot, every problem one timed call of every method and peer, in rounds."""

    noun = "speed block"
    measures: ClassVar[tuple[Measure, ...]] = MEASURES

    rounds: Count = key("Timed rounds; the time of a problem is their median.", 3)
    methods: Annotated[tuple[Entry, ...], Entries(Method)] = key("Methods of ours; ratios are taken to the first.")
    peers: Annotated[tuple[Entry, ...], Entries(IKPeer)] = key("Methods of other packages.", ())
    evaluation_budgets: Annotated[tuple[Count, ...], LISTED, AfterValidator(_sorted)] = key(
        "Numbers of iterations at which the methods that accept one are also compared.", ()
    )

    @property
    def entries(self) -> tuple[Entry, ...]:
        """The methods, then the peers."""
        return (*self.methods, *self.peers)

    @property
    def reference(self) -> str:
        """Label that ratios are taken to: the first method."""
        return self.methods[0].label
