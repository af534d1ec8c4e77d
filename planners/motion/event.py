"""Events: signals at instants of a motion."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from optik.arm.plain import read_list, read_word
from optik.check import check_number
from optik.errors import InvalidInput

EVENT_KEYS = ("t", "signal", "value", "s", "before", "shift")
"""Keys of an event in a file."""


class Event(NamedTuple):
    """A signal at an instant of a motion.

    Attributes
    ----------
    t : float
        Its time since the start [s].
    signal : str
        Name of the signal.
    value : bool, int, float or str
        The value that it takes.
    s : float or None
        The path parameter of its place [m, or rad]; None for a given time.
    before : float
        Time [s] by which the event precedes the instant at which the motion is at s; negative if it follows.
    shift : float
        What was added to its time so that it is a whole number of servo periods [s].
    """

    t: float
    signal: str
    value: bool | int | float | str = 1
    s: float | None = None
    before: float = 0.0
    shift: float = 0.0

    def slowed(self, factor: float) -> Event:
        """Return the event of the motion stretched in time by a factor; a given time stays.

        Parameters
        ----------
        factor : float
            New duration over the old one [1].

        Returns
        -------
        Event
            Without a shift.
        """
        if self.s is None:
            return self
        return self._replace(t=max((self.t - self.shift + self.before) * factor - self.before, 0.0), shift=0.0)


def check_signal(signal: Any, value: Any) -> None:
    """Raise InvalidInput unless a signal has a name and a value that files can hold."""
    if not isinstance(signal, str) or not signal.isprintable() or not signal:
        raise InvalidInput("signal", repr(signal)[:60], "a name that can be printed")
    if not isinstance(value, bool | int | float | str) or (isinstance(value, float) and value - value != 0.0):
        raise InvalidInput("value", repr(value)[:60], "True, False, a finite number or a text")


def events_to_plain(events: Sequence[Event]) -> list[dict[str, Any]]:
    """Return events as plain data for files."""
    return [event._asdict() for event in events]


def read_events(data: Any) -> tuple[Event, ...]:
    """Return the events that `events_to_plain` wrote, after checking them."""
    events = []
    for row in read_list(data, "events"):
        if not isinstance(row, dict) or set(row) != set(EVENT_KEYS):
            raise InvalidInput("events", repr(row)[:60], f"mappings with {', '.join(EVENT_KEYS)}")
        check_signal(read_word(row["signal"], "events"), row["value"])
        for key in EVENT_KEYS:
            if key in ("t", "before", "shift") or (key == "s" and row[key] is not None):
                check_number(row[key], f"events.{key}", "a number")
        events.append(Event(**row))
    return tuple(events)
