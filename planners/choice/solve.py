"""Interior-point iteration over the motion and the coefficients of its path together, with a bordered Newton step."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from optik.types import Array, Flags
from planners.choice.programme import ChoicePlace, FreeProgramme
from planners.paths.control_curve import ControlBounds
from planners.timing.interior_point import iteration
from planners.timing.interior_point.newton import Problem, back, forth

FIRST_WEIGHT, LAST_WEIGHT = 0.01, 3e-5
"""First and last weight of the barrier, relative to the mean duration of an interval; the law solves the path found again."""
MOST_FREE_STEPS, STEP_HALVINGS = 150, 12
"""Most Newton steps, and most halvings of each."""
ROUGH_RESIDUAL = 0.05
"""Residual per grid point below which a duration that is short enough ends the iteration."""
LEAST_PROGRESS, SLOW_STEPS, SMALL_WEIGHT, SMALL_RESIDUAL = 1e-3, 10, 5e-3, 1e-2
"""The iteration ends if the duration changed by less than the fraction `LEAST_PROGRESS` in `SLOW_STEPS` steps, with a weight
below `SMALL_WEIGHT` and a residual per grid point below `SMALL_RESIDUAL`: the law solves the path found again."""
SLOWEST_START = 1.5
"""Largest factor by which the initial guess is slowed."""
LONGEST_STEPS = (1.0, 0.3)
"""Longest step of a coefficient [rad, m], of the first attempt and of one after it failed: the constraint values are not linear
farther away. A longer step is damped."""
CLOSE_STEP, CLOSE_CHANGE, SHORT_STEP = 0.2, 5e-3, 0.3
"""The weight of the barrier falls after a step of the coefficients up to `CLOSE_STEP` [rad, m] that changes the duration by up
to the fraction `CLOSE_CHANGE`. An accepted step counts as short below the fraction `SHORT_STEP` of the possible length."""
STUCK_LENGTH, STUCK_STEPS = 1e-3, 10
"""A weight of the barrier has failed after so many steps in a row of which less than this fraction was possible."""
LEAST_INERTIA = 1e-6
"""Least multiple of the identity that is added to a Hessian which is not convex along the constraints."""
LEAST_P_DAMPING, FIRST_DAMPING, MOST_DAMPING = 1e-6, 1e-3, 1e6
"""Curvature that is added in each coefficient [1/rad²], since some do not change the motion: the least, the least after a step
that was too long, and the most."""
SIGN = np.array([1.0, -1.0])[:, None, None]
"""Signs of the upper and of the lower limit of a value."""


class FreeSolution(NamedTuple):
    """Coefficients (C, D), motion z (K + 1, 4), its duration [s], dT/dp (C, D) [s/rad], Newton steps, and configurations."""

    p: Array
    z: Array
    duration: float
    gradient: Array
    steps: int
    path: Array


class _Box:
    """The bounds of the coefficients as constraint values c in [−1, 1], with their slacks and multipliers."""

    def __init__(self, bounds: ControlBounds, free: Flags, p: Array, mu: float) -> None:
        self.discs, self.free = bounds.discs, free.reshape(p.shape)
        width = bounds.upper - bounds.lower
        bounded = np.isfinite(width) & self.free
        with np.errstate(invalid="ignore"):
            self.factor = np.where(bounded, 2.0 / np.where(bounded, width, 1.0), 0.0)
            self.middle = np.where(bounded, 0.5 * (bounds.upper + bounds.lower), 0.0)
        self.c = self.values(p)
        self.slack = np.maximum(1.0 - SIGN * self.c, 1e-2)
        self.dual = mu / self.slack
        rows = np.asarray(self.free.any(axis=1))[:, None]
        self.active = np.concatenate([bounded, np.repeat(rows, len(self.discs), axis=1)], axis=1)

    def values(self, p: Array) -> Array:
        """Return the constraint values (C, D + discs)."""
        discs = [((p[:, d] ** 2 + p[:, d + 1] ** 2) / radius**2)[:, None] for d, radius in self.discs]
        return np.concatenate([(p - self.middle) * self.factor, *discs], axis=1)

    def model(self, p: Array, mu: float, own: Array, pull: Array, damping: float) -> None:
        """Write the Hessian (P, D) and the gradient (P,) of the barrier."""
        (C, D), (above, below), (up, down), c = p.shape, 1.0 / self.slack, self.dual, self.c
        weight = np.where(self.active, up * above + down * below, 0.0)
        higher, lower = (mu + up * (c - 1.0)) * above + up, (mu - down * (c + 1.0)) * below + down
        slope = np.where(self.active, higher - lower, 0.0)
        H, g = np.zeros((C, D, D)), slope[:, :D] * self.factor
        i = np.arange(D)
        H[:, i, i] = weight[:, :D] * self.factor**2 + damping
        for at, (d, radius) in enumerate(self.discs, D):
            e = 2.0 * p[:, d : d + 2] / radius**2
            H[:, d : d + 2, d : d + 2] += weight[:, at, None, None] * e[:, :, None] * e[:, None, :]
            y = np.where(self.active[:, at], up[:, at] - down[:, at], 0.0)
            for x in (d, d + 1):
                H[:, x, x] += np.maximum(y, 0.0) * 2.0 / radius**2
            g[:, d : d + 2] += slope[:, at, None] * e
        H[~self.free] = 0.0
        H[:, i, i] = np.where(self.free, H[:, i, i], 1.0)
        own[:], pull[:] = H.reshape(C * D, D), np.where(self.free, g, 0.0).ravel()

    def step(self, p: Array, dp: Array, mu: float, keep: float) -> tuple[float, float]:
        """Compute the steps of slacks and multipliers; return the lengths that keep them positive."""
        D = p.shape[1]
        dc = np.concatenate([dp * self.factor, np.zeros((len(p), len(self.discs)))], axis=1)
        for at, (d, radius) in enumerate(self.discs, D):
            dc[:, at] = 2.0 * (p[:, d] * dp[:, d] + p[:, d + 1] * dp[:, d + 1]) / radius**2
        self.dslack = np.where(self.active, 1.0 - SIGN * (self.c + dc) - self.slack, 0.0)
        self.ddual = np.where(self.active, (mu - self.dual * self.dslack) / self.slack - self.dual, 0.0)
        lengths = []
        for x, dx in ((self.slack, self.dslack), (self.dual, self.ddual)):
            fall = -dx / x
            lengths.append(min(1.0, keep / max(float(fall.max(initial=0.0)), keep)))
        return lengths[0], lengths[1]

    def merit(self, c: Array, slack: Array, mu: float) -> tuple[float, float]:
        """Return the barrier's part of the objective, and of the residuals."""
        objective = -mu * float(np.where(self.active, np.log(slack), 0.0).sum())
        return objective, float(np.where(self.active, np.abs(SIGN * c + slack - 1.0), 0.0).sum())

    def accept(self, c: Array, alpha: float, dual: float) -> None:
        """Move slacks and multipliers."""
        self.c, self.slack = c, np.maximum(self.slack + alpha * self.dslack, 1.0 - SIGN * c)
        self.dual = self.dual + dual * self.ddual


def _slow_down(programme: FreeProgramme, problem: Problem, z: Array) -> Array:
    """Return the motion z, slowed until it uses at most 0.9 of the limits, by at most a constant factor."""
    K, m, e = programme.K, problem.node.shape[1], problem.edge.shape[2]
    g, c = np.zeros((K, 3)), np.zeros((K + 1, m + 2 * e))
    iteration.values(problem, z, g, c)
    counts = programme.scales.counts
    first = programme.speeds
    last = programme.rows - int(counts[5] + counts[6])
    static = problem.node[:, first:last, 3]
    room = np.maximum(1.0 - np.copysign(1.0, c[:, first:last]) * static, 1e-3)
    second = (np.abs(c[:, first:last]) - np.copysign(1.0, c[:, first:last]) * static) / room
    factor = max(
        1.0, float(np.abs(c[:, :first]).max(initial=0.0)) / 0.9, np.sqrt(max(float(second.max(initial=0.0)), 0.0) / 0.9),
        np.cbrt(float(np.abs(c[:, m:]).max(initial=0.0)) / 0.9),
    )  # fmt: skip
    factor = min(factor, SLOWEST_START)
    return np.asarray(z / np.array([factor, factor**2, 1.0 / factor, factor**3]))


def solve_coefficients(
    programme: FreeProgramme, p: Array, bounds: ControlBounds, near: Array, *, least: float = LAST_WEIGHT,
    damping: float = LEAST_P_DAMPING, enough: float = 0.0,
) -> FreeSolution | None:  # fmt: skip
    """Return the fastest motion over the coefficients near an initial guess p (C, D); None if the iteration finds none.

    near (4, K + 1, n) are configurations and their derivatives for p, or near them. A last weight below the default asks for
    the optimum itself, not only for the path. The iteration ends at a duration of `enough` [s].
    """
    place = programme.place(p, near)
    if place is None:
        return None
    for longest in LONGEST_STEPS:
        found = _Iteration(programme, p.copy(), bounds, place, longest, damping).run(least, enough)
        if found is not None:
            return found
    return None


class _Iteration:
    """State of the iteration: coefficients p, the joints for them, and the motion with its slacks and multipliers."""

    def __init__(
        self, programme: FreeProgramme, p: Array, bounds: ControlBounds, place: ChoicePlace, longest: float, damping: float
    ) -> None:  # fmt: skip
        self.programme, self.p, self.place, self.longest = programme, p, place, longest
        self.problem, K = programme.problem(place), programme.K
        rows = self.problem.node.shape[1] + 2 * self.problem.edge.shape[2]
        self.border, self.mu = programme.make_border(), FIRST_WEIGHT
        self.at, self.trial = iteration.make_iterate(K, rows), iteration.make_iterate(K, rows)
        self.at.z[:] = _slow_down(programme, self.problem, programme.given.start)
        iteration.move_inside(self.problem, self.at, self.mu)
        iteration.centre(self.problem, self.at, self.mu)
        self.box = _Box(bounds, programme.window.free, p, self.mu)
        self.d, self.lam, self.slope = np.zeros((K + 1, 4)), np.zeros((K + 1, 3)), np.zeros((K + 1, rows))
        self.dslack, self.ddual = np.zeros((K + 1, 2, rows)), np.zeros((K + 1, 2, rows))
        self.dbound = np.zeros((K + 1, 3))
        self.models, self.law, self.cost = np.empty((K, 4, 5)), np.empty((K, 3)), np.empty((K + 1, 5))
        self.passed, self.count, self.delta = np.empty((2, MOST_FREE_STEPS)), 0, 0.0
        self.damping = self.least_damping = damping

    def run(self, least: float, fast: float) -> FreeSolution | None:
        """Return the solution at the last barrier weight, or as soon as the duration no longer falls or is at most `fast` [s].

        If a weight fails, the solution is that of the weight before it.
        """
        K, durations, stuck, kept = self.programme.K, [float(self.at.z[:-1, 2].sum())], 0, None
        for steps in range(1, MOST_FREE_STEPS + 1):
            moved = self._search() if self._newton() else None
            if moved is None:
                return kept
            alpha, dual, off, longest = moved
            stuck = stuck + 1 if alpha < STUCK_LENGTH else 0
            if stuck == STUCK_STEPS:
                return kept
            durations.append(float(self.at.z[:-1, 2].sum()))
            before = durations[-1 - SLOW_STEPS] if steps > SLOW_STEPS else np.inf
            slow = abs(before - durations[-1]) < LEAST_PROGRESS * durations[-1]
            enough = off < SMALL_RESIDUAL * K and self.mu < SMALL_WEIGHT and least >= LAST_WEIGHT
            if enough and (slow or steps == MOST_FREE_STEPS):
                return self._solution(steps)
            if off < ROUGH_RESIDUAL * K and durations[-1] * self.programme.given.units[1] <= fast:
                return self._solution(steps)
            close = longest < CLOSE_STEP and abs(durations[-2] - durations[-1]) < CLOSE_CHANGE * durations[-1]
            if alpha > 0.7 and dual > 0.7 and off <= 10.0 * self.mu * K and close:
                if self.mu <= least and off < 1e-6 * K:
                    return self._solution(steps)
                if enough:
                    kept = self._solution(steps)
                self.mu, self.count = max(least, min(0.2 * self.mu, self.mu**1.5)), 0
        return kept

    def _newton(self) -> bool:
        """Compute the Newton step, with the coefficients damped until theirs is short enough; return whether there is one."""
        at, border, size = self.at, self.border, np.inf
        self.programme.fill(self.place, at.z, at.dual[:, 0] - at.dual[:, 1], border)
        while True:
            self.box.model(self.p, self.mu, border.own, border.pull, self.damping)
            delta = self.delta / 3.0 if self.delta > LEAST_INERTIA else 0.0  # usually enough, with one factorisation
            while not back(self.problem, at, self.mu, delta, self.models, self.law, self.cost, border):
                delta = max(4.0 * delta, LEAST_INERTIA)
                if delta > 1e8:
                    return False
            forth(self.problem, at, self.models, self.law, self.cost, self.d, self.lam, border)
            size = float(np.abs(border.d).max())
            if size <= self.longest or self.damping > MOST_DAMPING:
                break
            self.damping = max(10.0 * self.damping, FIRST_DAMPING)
        self.delta = delta
        return True

    def _search(self) -> tuple[float, float, float, float] | None:
        """Move along the step as far as the filter accepts; return lengths, residual and the coefficients' step, or None."""
        at, trial, border, box, p, mu = self.at, self.trial, self.border, self.box, self.p, self.mu
        iteration.slopes(self.problem, at.z, self.d, self.slope, border)
        alpha, dual = iteration.lengths(
            self.problem, at, mu, self.d, self.slope, self.dslack, self.ddual, self.dbound, border
        )  # fmt: skip
        dp = border.d.reshape(p.shape).copy()
        others = box.step(p, dp, mu, max(0.99, 1.0 - mu))
        alpha, dual = min(alpha, others[0]), min(dual, others[1])
        whole, accepted = alpha, None
        objective, off = iteration.merit(self.problem, mu, at.z, at.g, at.c, at.slack, border)
        more = box.merit(box.c, box.slack, mu)
        self.passed[0, self.count], self.passed[1, self.count] = objective + more[0], off + more[1]
        self.count += 1
        for _ in range(STEP_HALVINGS):
            new = p + alpha * dp
            place = self.programme.place(new, self.place.path)
            if place is not None and self.programme.allows(place):
                problem, c = self.programme.problem(place), box.values(new)
                iteration.step(at, alpha, self.d, self.dslack, trial)
                iteration.values(problem, trial.z, trial.g, trial.c)
                objective, off = iteration.merit(problem, mu, trial.z, trial.g, trial.c, trial.slack, border)
                more = box.merit(c, box.slack + alpha * box.dslack, mu)
                off += more[1]
                accepted = place, problem, new, c
                if iteration.is_better(self.passed, self.count, objective + more[0], off, 1e-6 * self.programme.K):
                    break
            alpha *= 0.5
        if accepted is None:
            return None
        self.place, self.problem, self.p, c = accepted
        iteration.accept(at, trial, alpha, dual, self.lam, self.ddual, self.dbound)
        box.accept(c, alpha, dual)
        self._renew()
        if alpha < SHORT_STEP * whole:
            self.damping = min(max(10.0 * self.damping, FIRST_DAMPING), MOST_DAMPING)
        else:
            self.damping = max(0.3 * self.damping, self.least_damping)
        return alpha, dual, off, float(np.abs(dp).max())

    def _renew(self) -> None:
        """Let further limits choose what they limit; set the slacks and multipliers of what changed on the central path."""
        at, (k, row) = self.at, self.programme.renew(self.place)
        if not k.size:
            return
        self.problem, self.count = self.programme.problem(self.place), 0
        iteration.values(self.problem, at.z, at.g, at.c)
        weight = self.mu * self.problem.tau[np.minimum(k, self.programme.K - 1)]
        for side, sign in enumerate((1.0, -1.0)):
            at.slack[k, side, row] = np.maximum(1.0 - sign * at.c[k, row], 1e-2)
            at.dual[k, side, row] = weight / at.slack[k, side, row]

    def _solution(self, steps: int) -> FreeSolution:
        """Return the solution at the present iterate."""
        y, programme, border = self.at.dual[:, 0] - self.at.dual[:, 1], self.programme, self.border
        programme.fill(self.place, self.at.z, y, border)
        time = programme.given.units[1]
        gradient = programme.gather(y, border).reshape(self.p.shape) * time
        duration = float(self.at.z[:-1, 2].sum()) * time
        return FreeSolution(self.p, self.at.z.copy(), duration, gradient, steps, self.place.path)
