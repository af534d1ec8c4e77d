"""Boards: plots that share controls; what a browser needs to draw them, as strict JSON."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

Json = dict[str, Any]
When = Mapping[str, Sequence[str]]
"""Values of controls at which something is shown; a control that is not named does not matter."""


@dataclass(frozen=True)
class Control:
    """A control with which the reader chooses what a board shows."""

    key: str
    label: str
    options: tuple[tuple[str, str], ...]
    initial: str = ""
    when: When = field(default_factory=dict)

    @property
    def value(self) -> str:
        """The value that is chosen at first."""
        return self.initial or self.options[0][0]

    @staticmethod
    def of(key: str, label: str, values: Sequence[str], initial: str = "") -> Control:
        """A choice among values that are their own names.

        Parameters
        ----------
        key, label : str
            Name of the control, and what the page calls it.
        values : sequence of str
            What can be chosen.
        initial : str
            What is chosen first; the first value where empty.

        Returns
        -------
        Control
            The control.
        """
        return Control(key, label, tuple((v, v) for v in values), initial)


@dataclass(frozen=True)
class Key:
    """One entry of a legend: a line or a filled square."""

    label: str
    colour: str
    style: str = "solid"
    when: When = field(default_factory=dict)


@dataclass
class Plot:
    """One plot: traces and layouts, each with the choices at which it is shown.

    Attributes
    ----------
    id : str
        Unique on the page.
    title : str
        Shown above the plot, and read out.
    layout : dict
        Plotly layout that is always there.
    height : int
        [px]; 0 for a square. A layout's own height wins.
    """

    id: str
    title: str
    layout: Json
    height: int = 340
    traces: list[Json] = field(default_factory=list)
    layouts: list[Json] = field(default_factory=list)
    frames: list[Json] = field(default_factory=list)

    def add(self, trace: Json, when: When | None = None, variants: Sequence[tuple[When, Json]] = ()) -> None:
        """Show a trace at some choices; variants change its look at others.

        Parameters
        ----------
        trace : dict
            A trace of Plotly.
        when : mapping
            Values of controls at which it is shown; always where None.
        variants : sequence of tuple
            Values of controls, and what changes in the trace there.
        """
        entry: Json = {"trace": trace}
        if when:
            entry["when"] = when
        if variants:
            entry["variants"] = [{"when": w, "patch": p} for w, p in variants]
        self.traces.append(entry)

    def vary(self, when: When, layout: Json) -> None:
        """Change the layout at some choices; later changes win.

        Parameters
        ----------
        when : mapping
            Values of controls.
        layout : dict
            What changes in the layout there.
        """
        self.layouts.append({"when": when, "layout": layout})


@dataclass(frozen=True)
class Board:
    """Plots that share controls, a legend and a caption."""

    id: str
    plots: tuple[Plot, ...]
    controls: tuple[Control, ...] = ()
    legend: tuple[Key, ...] = ()
    caption: str = ""

    @property
    def shown(self) -> tuple[Control, ...]:
        """Controls with more than one option."""
        return tuple(c for c in self.controls if len(c.options) > 1)

    @property
    def animated(self) -> bool:
        """Whether a plot of it moves."""
        return any(p.frames for p in self.plots)

    def to_json(self) -> str:
        """Everything the page's script needs."""
        keep = ("id", "layout", "traces", "layouts", "frames")
        return strict(
            {
                "state": {c.key: c.value for c in self.controls},
                "plots": [{k: getattr(p, k) for k in keep if getattr(p, k)} for p in self.plots],
            }
        )


def strict(data: Any) -> str:
    """JSON without NaN that is safe inside a script element and an attribute.

    Parameters
    ----------
    data : object
        Dictionaries, lists, text, finite numbers, truth values and None.

    Returns
    -------
    str
        JSON.
    """
    text = json.dumps(data, allow_nan=False, ensure_ascii=False, separators=(",", ":"))
    for character in "<>&\u2028\u2029":
        text = text.replace(character, f"\\u{ord(character):04x}")
    return text
