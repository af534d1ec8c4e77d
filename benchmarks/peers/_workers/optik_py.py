"""The method that `serve.py` serves for optik-py (kylc): a Rust solver with gradients, random restarts and threads."""

import importlib
from typing import Any

MAX_TIME = 0.1
"""Time limit of a call [s], its default: long enough for its restarts also on a busy machine."""
TOL_F = 1e-13
"""Bound on its objective, half the squared norm of the error: with the default of 1e-6 no answer is within 1e-6 m and rad."""


class _Method:
    """``Robot.ik(config, target, x0)`` in Speed mode on one thread."""

    def __init__(self, model: dict[str, Any]) -> None:
        optik: Any = importlib.import_module("optik")  # optik-py, in its own environment
        self.robot = optik.Robot.from_urdf_file(model["urdf_file"], "link0", "tool")
        self.robot.set_parallelism(1)
        self.config = optik.SolverConfig("speed", max_time=MAX_TIME, tol_f=TOL_F)

    def prepared(self, target: list[Any], q0: list[float]) -> tuple[Any, ...]:
        """Return the arguments of `call` in the types of a user: the package takes lists."""
        return self.config, target, q0

    def call(self, config: Any, target: list[Any], q0: list[float]) -> Any:
        """Make the timed call."""
        return self.robot.ik(config, target, q0)

    def answer(self, raw: Any) -> Any:
        """Return configuration, iterations (not reported) and claim of a call."""
        return (None, None, False) if raw is None else (raw[0], None, True)

    def fk(self, q: list[float]) -> Any:
        """Return the tool pose by its own model."""
        return self.robot.fk(q)


METHOD = _Method
