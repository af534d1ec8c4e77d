"""What two runs are compared on: measures of a kind's rows, problem by problem."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Compared:
    """One measure that two runs are compared on.

    Attributes
    ----------
    words : str
        What the comparison calls it.
    unit : str
        Of its values; ``%`` for a share.
    better : str
        ``more`` or ``less``.
    column : str
        Column of the kind's rows that has it: truth values for a share, else positive numbers.
    scale : float
        By which the column is multiplied for the unit.
    only : str
        Column of truth values: problems are compared where it is true in both runs; all where empty.
    rounds : tuple of str
        Columns of the least and the largest value of the rounds of a timed call; empty where there are none.
    exact : bool
        Whether every run gives the same value, rounding aside: then any change is better or worse, without a test.
    """

    words: str
    unit: str
    better: str
    column: str
    scale: float = 1.0
    only: str = ""
    rounds: tuple[str, str] | tuple[()] = ()
    exact: bool = False

    @property
    def is_share(self) -> bool:
        """Whether its values are truth values, of which the share is compared."""
        return self.unit == "%"
