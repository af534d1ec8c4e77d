"""Turn about the tool's axis z: a torch, a nozzle or a spindle does not care."""

from planners.freedom.base import Freedom


class Turn(Freedom):
    """Turn of the tool about its own axis z."""

    name = "turn"
    screws = ((0.0, 0.0, 0.0, 0.0, 0.0, 1.0),)


METHOD = Turn
