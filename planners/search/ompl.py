"""RRT-Connect of OMPL, the Open Motion Planning Library, with our proved edges; needs the extra `ompl`."""

from __future__ import annotations

from threading import Lock
from typing import Any, ClassVar

import numpy as np

from optik.check import check_number
from optik.errors import MissingDependency
from optik.types import Array
from planners.search.base import JointSpace, Search, SearchAttempt

_ONE_SEARCH = Lock()
"""OMPL takes the seed of all its random numbers from one place of the process."""


class OMPL(Search):
    """RRT-Connect of OMPL with the edges and configurations of `JointSpace`.

    Parameters
    ----------
    max_samples : int
        Largest number of iterations; OMPL has no restarts.
    step : float
        Longest edge in joint space [rad, m].

    Raises
    ------
    MissingDependency
        Without the package ompl.
    """

    name: ClassVar[str] = "ompl"

    def __init__(self, max_samples: int = 100_000, step: float = 1.0) -> None:
        super().__init__(max_samples)
        try:
            import ompl  # noqa: F401
        except ModuleNotFoundError:
            raise MissingDependency("ompl", "search 'ompl'", "ompl") from None
        self.step = check_number(step, "step", "a joint motion above 0 [rad, m]", above=0.0)

    def search(self, space: JointSpace, start: Array, goals: Array, seed: tuple[int, ...]) -> SearchAttempt:  # noqa: D102
        from ompl import util

        with _ONE_SEARCH:
            level = util.getLogLevel()
            util.setLogLevel(util.LOG_NONE)  # a second seed in a process is an error in its log, and used nevertheless
            try:
                util.RNG.setSeed(1 + int(np.random.SeedSequence(seed).generate_state(1)[0] >> 1))
                return self._search(space, start, goals)
            finally:
                util.setLogLevel(level)

    def _search(self, space: JointSpace, start: Array, goals: Array) -> SearchAttempt:
        from ompl import base, geometric

        class Validator(base.MotionValidator):  # type: ignore[misc]
            def checkMotion(self, first: Any, last: Any) -> bool:
                return space.is_edge_free(_read_state(first, space), _read_state(last, space))

        reals, bounds = base.RealVectorStateSpace(space.robot.n), base.RealVectorBounds(space.robot.n)
        for i, (low, high) in enumerate(zip(*space.find_range(np.array([start, *goals])), strict=True)):
            bounds.setLow(i, float(low))
            bounds.setHigh(i, float(high))
        reals.setBounds(bounds)
        information = base.SpaceInformation(reals)
        information.setMotionValidator(Validator(information))
        information.setStateValidityChecker(lambda state: space.is_free(_read_state(state, space)))
        information.setup()
        problem, goal = base.ProblemDefinition(information), base.GoalStates(information)
        problem.addStartState(_make_state(reals, start))
        for q in goals:
            goal.addState(_make_state(reals, q))
        problem.setGoal(goal)
        planner = geometric.RRTConnect(information)
        planner.setRange(self.step)
        planner.setProblemDefinition(problem)
        planner.setup()
        iterations = 0

        def is_used_up() -> bool:
            nonlocal iterations
            iterations += 1
            return iterations > self.max_samples

        planner.solve(base.PlannerTerminationCondition(is_used_up))
        used = min(iterations, self.max_samples)
        if not problem.hasExactSolution():
            return SearchAttempt(None, used)
        return SearchAttempt(
            np.array([_read_state(state, space) for state in problem.getSolutionPath().getStates()]), used
        )


def _read_state(state: Any, space: JointSpace) -> Array:
    return np.array([state[i] for i in range(space.robot.n)])


def _make_state(reals: Any, q: Array) -> Any:
    state = reals.allocState()
    for i, value in enumerate(q):
        state[i] = float(value)
    return state


METHOD = OMPL
