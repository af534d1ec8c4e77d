"""Settings of blocks of single calls."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from benchmarks.blocks._entries import check_labels, read_method, read_peers
from benchmarks.blocks._problems import ProblemBlock, named, read_problems
from benchmarks.blocks.base import Entry
from benchmarks.blocks.ik.calls.measures import MEASURES
from benchmarks.peers.ik import PEERS
from benchmarks.settings import all_of, check_different, check_list
from benchmarks.targets import read_target
from optik.check import check_count


@dataclass(frozen=True, kw_only=True)
class CallBlock(ProblemBlock):
    """One problem set on one robot, every problem one timed call of every method and peer, in rounds.

    Attributes
    ----------
    rounds : int
        How often each problem is solved; its time is the median.
    methods : tuple of Entry
        Methods of ours; ratios are taken to the first.
    peers : tuple of Entry
        Outside methods.
    evaluation_budgets : tuple of int
        Numbers of iterations at which the methods that can be told one are compared, besides; none where empty.
    """

    rounds: int
    methods: tuple[Entry, ...]
    peers: tuple[Entry, ...]
    evaluation_budgets: tuple[int, ...] = ()

    @property
    def entries(self) -> tuple[Entry, ...]:
        """The methods, then the peers."""
        return (*self.methods, *self.peers)

    @property
    def reference(self) -> str:
        """Label that ratios are taken to: the first method."""
        return self.methods[0].label


def read_block(data: Any) -> CallBlock:
    """Check the settings of a block of single calls and return it."""
    where = named(data, "speed block")
    shared = read_problems(data, where, {"rounds", "methods", "peers", "targets", "evaluation_budgets"}, {"methods"})
    check_count(data.get("rounds", 3), f"{where}: rounds", 1)
    methods = all_of(data["methods"], f"{where}: methods", lambda m: read_method(m, where))
    peers = read_peers(data.get("peers"), where, PEERS, budgets=True)
    labels = check_labels((*methods, *peers), f"{where}: methods")
    targets = all_of(data.get("targets"), f"{where}: targets", lambda t: read_target(t, where, MEASURES, labels=labels))
    given = data.get("evaluation_budgets")
    budgets = () if given is None else tuple(check_list(given, f"{where}: evaluation_budgets"))
    for count in budgets:
        check_count(count, f"{where}: evaluation_budgets", 1)
    check_different([str(count) for count in budgets], f"{where}: evaluation_budgets", "number")
    return CallBlock(
        **shared,
        rounds=data.get("rounds", 3),
        methods=methods,
        peers=peers,
        targets=targets,
        evaluation_budgets=tuple(sorted(budgets)),
    )
