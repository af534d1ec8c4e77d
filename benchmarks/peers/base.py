"""A peer: a method of another package, installed or absent, and the results of its calls."""

from __future__ import annotations

import importlib.util
from abc import ABC
from collections.abc import Callable, Sequence
from typing import Any, ClassVar, NamedTuple, Self

from benchmarks.provenance import version_here
from optik.errors import NoSolution


class Absent(Exception):
    """A peer that is not run; the message is the reason."""

    def __init__(self, why: str, outcome: str = "absent") -> None:
        super().__init__(why)
        # absent: its package is missing; refused: it does not support the robot; differs: its model of the robot is not ours
        self.why, self.outcome = why, outcome


class Failed(NoSolution):
    """A call that failed in a worker process."""

    def __init__(self, outcome: str, error: str) -> None:
        super().__init__(f"{outcome}: {error}")
        # raised (an exception) or crashed (its process ended); and what it said
        self.outcome, self.error = outcome, error


class Answer(NamedTuple):
    """One call that a worker process timed."""

    raw: Any  # what it returned, or `Failed`
    ns: int  # its time [ns]; where its process ended, the time until then
    cpu_ns: int | None  # time of all threads of its process [ns]; None where its process ended


class Peer(ABC):
    """A method of another package; its file binds the class to ``METHOD``.

    Attributes
    ----------
    distribution : str
        Name of its distribution, for ``pip install``.
    package : str
        Name of its package, for ``import``; imported in ``__init__`` only.
    settings : str
        How it is set up and called, for the report.
    call : callable
        The timed part, a complete call from Python.
    many : callable or None
        From a list of arguments of `call` to one `Answer` each, where another process makes and times the calls.

    Raises
    ------
    ModuleNotFoundError
        Its package is not installed.
    """

    distribution: ClassVar[str]
    package: ClassVar[str]
    settings: ClassVar[str]
    call: Callable[..., Any]
    many: Callable[[Sequence[tuple[Any, ...]]], list[Answer]] | None = None
    read: Callable[..., Any]  # from what a call returned to the answer; not timed

    @classmethod
    def missing(cls) -> str:
        """Return why it cannot run here, without importing it; empty if it can."""
        return "" if importlib.util.find_spec(cls.package) else f"pip install {cls.distribution}"

    @classmethod
    def version(cls) -> str | None:
        """Return the installed version of its distribution; None if it is not installed."""
        return version_here(cls.distribution)

    @classmethod
    def facts(cls, **options: Any) -> dict[str, Any]:
        """Return the facts for the report.

        Parameters
        ----------
        options : Any
            The options of `build`.

        Returns
        -------
        dict
            ``version``, ``settings``, and what its kind adds.
        """
        return {"version": cls.version(), "settings": cls.settings}

    @classmethod
    def build(cls, given: Any, **options: Any) -> Self:
        """Build it.

        Parameters
        ----------
        given : Robot or dict
            The robot of an IK method, or the limits of a time law.
        options : Any
            Options of the class.

        Returns
        -------
        Peer
            The peer, ready to be called.

        Raises
        ------
        Absent
            It cannot be run here.
        ModuleNotFoundError
            Another package than its own is missing.
        """
        try:
            return cls(given, **options)  # type: ignore[call-arg]
        except ModuleNotFoundError as error:
            if (error.name or "").partition(".")[0] != cls.package:
                raise
            raise Absent(f"not installed: pip install {cls.distribution}") from None
        except ImportError as error:  # installed, but not for this machine
            raise Absent(f"cannot be imported here: {error}") from None
