"""A freedom in one file: the distance of the tool from the path along its own axis z, for sprays, cameras and lasers.

Try it: ``optik plan line --free examples/plugins/standoff.py=10`` (±10 mm), or ``free(path, **{"./standoff.py": 0.01})``.
"""

from __future__ import annotations

from planners.freedom import Freedom


class Standoff(Freedom):
    """Distance along the tool's axis z [m]; pairs are ranges, such as (0.0, 0.02) for at most 20 mm behind the path."""

    unit = "m"
    screws = ((0.0, 0.0, 1.0, 0.0, 0.0, 0.0),)  # (v, ω) of the tool by a unit of the coordinate, in the tool's frame


METHOD = Standoff
