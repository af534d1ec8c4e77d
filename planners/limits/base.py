"""What a limit is: how its bound is given and filed, the rows that it puts on a time law, and its judgement of a motion."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from optik.arm.limits import positive
from optik.arm.plain import numbers, plain_numbers
from optik.arm.robot import Robot
from optik.check import check_number
from optik.types import Array, Flags
from planners.certificate.continuity import steps
from planners.certificate.examined import Examined
from planners.curve import chain_rows
from planners.limits._points import PathPoints


class Extreme(NamedTuple):
    """Exact worst absolute value of each joint (n,), its ratio to the limit (n,), and its time [s] (n,)."""

    value: Array
    ratio: Array
    time: Array

    def worst(self, names: tuple[str, ...]) -> tuple[float, str, float]:
        """Return the worst ratio, its joint and its time; NaN and an empty name where no joint is limited.

        Parameters
        ----------
        names : tuple of str
            Names of the joints.

        Returns
        -------
        tuple of float, str and float
            Ratio [1], joint and time [s].
        """
        if np.isnan(self.ratio).all():
            return float("nan"), "", float("nan")
        i = int(np.nanargmax(self.ratio))
        return float(self.ratio[i]), names[i], float(self.time[i])

    def to_dict(self) -> dict[str, Any]:
        """Plain data for files: lists of n numbers, None for infinite and undefined ones."""
        return {k: plain(v) for k, v in self._asdict().items()}


class ToolExtreme(NamedTuple):
    """Proved bound on a value of the whole arm, its ratio to the limit (NaN without one), and when it is nearly reached [s]."""

    value: float
    ratio: float
    time: float

    def worst(self, names: tuple[str, ...]) -> tuple[float, str, float]:
        """Return the ratio, what is limited, and the time.

        Parameters
        ----------
        names : tuple of str
            The name of what is limited, such as ``"tool"``.

        Returns
        -------
        tuple of float, str and float
            Ratio [1], name and time [s].
        """
        return self.ratio, names[0], self.time

    def to_dict(self) -> dict[str, Any]:
        """Plain data for files; None for a ratio that is infinite or undefined."""
        return {"value": self.value, "ratio": self.ratio if np.isfinite(self.ratio) else None, "time": self.time}


def plain(values: Array) -> list[float | None]:
    """List of numbers that JSON can hold.

    Parameters
    ----------
    values : (k,) array
        Numbers, of any unit.

    Returns
    -------
    list of float or None
        None for infinity (a jump) and NaN (no limit).
    """
    return [float(v) if np.isfinite(v) else None for v in values]


class Limit(ABC):
    """One kind of limit. It is the only place that knows what its bound means.

    A limit is a subclass in a file of its own in this folder that names itself ``METHOD``, or an object that is made known
    by `planners.limits.register`. The file's stem is its ``name``: its key in motion files, in ``MotionLimits(extra=...)``,
    in `TimeLaw.keeps` and in certificates.

    Attributes
    ----------
    name : str
        The key.
    units : tuple of str
        Unit of the bound for revolute and for sliding joints; a limit of the whole arm repeats its one unit.
    order : int
        Power of the time scale: a motion run c times as slowly has 1 / c**order of the value. Also the order of its rows.
    subject : str or None
        What the one bound of the whole arm is on, such as ``"tool"``; None for a bound on every joint.
    """

    name: ClassVar[str]
    units: ClassVar[tuple[str, str]]
    order: ClassVar[int]
    subject: ClassVar[str | None] = None

    # ------------------------------------------------------------ the bound, as given and in files

    def checked(self, value: Any) -> Any:
        """Return a bound as `MotionLimits` keeps it: a float, or a read-only array.

        Parameters
        ----------
        value : scalar or (n,) array
            The bound, in `units`; a scalar for a limit of the whole arm.

        Returns
        -------
        float or (n,) array
            The bound, in `units`.

        Raises
        ------
        InvalidInput
            No number, or none above 0.
        """
        if self.subject is not None:
            return check_number(value, self.name, f"a {self.name.replace('_', ' ')} above 0", above=0.0)
        kept = positive(value, np.size(value), self.name)
        return kept if np.ndim(value) else float(kept[0])

    def array(self, value: ArrayLike | None, n: int) -> Array:
        """Return a bound as an array, one entry for each subject.

        Parameters
        ----------
        value : scalar or (n,) array, or None
            What `checked` returned, in `units`; None where nothing is limited.
        n : int
            Number of joints.

        Returns
        -------
        (n,) array, or (1,) array for a limit of the whole arm
            In `units`, infinity where free; read-only.

        Raises
        ------
        InvalidInput
            A length other than n.
        """
        return positive(np.inf if value is None else value, 1 if self.subject is not None else n, self.name)

    def to_plain(self, value: ArrayLike | None) -> Any:
        """Return a bound as plain data for files.

        Parameters
        ----------
        value : scalar or (n,) array, or None
            What `checked` returned, in `units`.

        Returns
        -------
        float, list or None
            Read back by `from_plain` to the last bit.
        """
        return None if value is None else plain_numbers(value)

    def from_plain(self, data: Any, n: int) -> Array | float | None:
        """Return the bound that `to_plain` wrote.

        Parameters
        ----------
        data : float, list or None
            Plain data.
        n : int
            Number of joints.

        Returns
        -------
        float, (n,) array or None
            The bound, in `units`.

        Raises
        ------
        InvalidInput
            Data that describe no bound.
        """
        if data is None:
            return None
        if self.subject is None and isinstance(data, list):
            return numbers(data, (n,), f"limits.{self.name}")
        return float(numbers(data, (), f"limits.{self.name}"))

    # ------------------------------------------------------------ time laws

    @abstractmethod
    def rows(self, at: PathPoints, bound: Array) -> Array:
        """Coefficients of the limited value over its bound, at points of a joint path.

        Parameters
        ----------
        at : PathPoints
            Points of the joint path.
        bound : (m,) array
            What `array` returned, in `units`.

        Returns
        -------
        (k, m, order) array
            Over the monomials of `planners.curve.monomials` [1 over theirs]: ṡ for order 1, s̈ and ṡ² for order 2,
            s⃛, ṡ s̈ and ṡ³ for order 3. The limit is kept where |rows · monomials| ≤ 1.
        """

    # ------------------------------------------------------------ judgement

    def subjects(self, robot: Robot) -> tuple[str, ...]:
        """Names of what the bounds are on.

        Parameters
        ----------
        robot : Robot
            The arm.

        Returns
        -------
        tuple of str
            The joints' names, or the one `subject`.
        """
        return robot.joint_names if self.subject is None else (self.subject,)

    @abstractmethod
    def judge(self, motion: Examined, bound: Array) -> Extreme | ToolExtreme:
        """Worst value over a whole motion: exact or a proved bound, not the largest of samples.

        Parameters
        ----------
        motion : Examined
            The motion.
        bound : (m,) array
            What `array` returned, in `units`.

        Returns
        -------
        Extreme or ToolExtreme
            The first for a bound on every joint, the second for one on the whole arm.
        """

    @abstractmethod
    def piece_ratios(self, motion: Examined, bound: Array) -> Array:
        """Worst ratio to the bound on each piece of a motion, to say which constraint is active there.

        Parameters
        ----------
        motion : Examined
            The motion.
        bound : (m,) array
            What `array` returned, in `units`.

        Returns
        -------
        (pieces, m) array
            Ratios [1]; 0 where free.
        """

    def slowing(self, motion: Examined, bound: Array) -> float:
        """Least factor by which a motion is stretched in time so that it keeps the limit.

        A limit whose value has a part that no slowing changes (the torque against gravity) overrides this, and returns
        infinity where no factor suffices.

        Parameters
        ----------
        motion : Examined
            The motion.
        bound : (m,) array
            What `array` returned, in `units`.

        Returns
        -------
        float
            Below 1 where the motion may be run faster; 0 where nothing limits it.
        """
        if not np.isfinite(bound).any():
            return 0.0
        ratio = float(np.nanmax(self.judge(motion, bound).ratio))
        return scale_of(ratio, self.order)


def scale_of(ratio: float, order: int) -> float:
    """Time scale at which a value that goes with 1 / scale**order is at its bound.

    Parameters
    ----------
    ratio : float
        Value over bound [1].
    order : int
        Power of the time scale.

    Returns
    -------
    float
        Above 1 wherever the ratio is, however the root rounds.
    """
    return float(max(ratio ** (1.0 / order), np.nextafter(1.0, 2.0) if ratio > 1.0 else 0.0))


class DerivativeLimit(Limit):
    """A limit on a derivative of every joint in time: the exact extrema of the polynomials judge it."""

    def rows(self, at: PathPoints, bound: Array) -> Array:
        """The chain rule's coefficients over the bound; see `Limit.rows`.

        Parameters
        ----------
        at : PathPoints
            Points of the joint path.
        bound : (m,) array
            What `Limit.array` returned [as its units].

        Returns
        -------
        (k, m, order) array
            [as 1 over the monomials].
        """
        return chain_rows([at.q(order) for order in range(1, self.order + 1)]) / bound[:, None]

    def judge(self, motion: Examined, bound: Array) -> Extreme:
        """Exact extrema; infinite where a lower derivative jumps. See `Limit.judge`.

        Parameters
        ----------
        motion : Examined
            The motion.
        bound : (m,) array
            What `Limit.array` returned [as its units].

        Returns
        -------
        Extreme
            Value, ratio and time.
        """
        extrema = motion.trajectory.extrema(self.order)
        ratio = np.where(np.isfinite(bound), extrema.worst / bound, np.nan)
        extreme = Extreme(extrema.worst, ratio, extrema.t_worst)
        for order in range(self.order):
            if motion.jumps[order].any():
                extreme = _infinite_at_jumps(motion, order, extreme, motion.jumps[order], bound)
        return extreme

    def piece_ratios(self, motion: Examined, bound: Array) -> Array:
        """Exact worst values of each piece over the bound; see `Limit.piece_ratios`.

        Parameters
        ----------
        motion : Examined
            The motion.
        bound : (m,) array
            What `Limit.array` returned [as its units].

        Returns
        -------
        (pieces, m) array
            Ratios [1].
        """
        return motion.trajectory.piece_worst(self.order) / bound

    def slowing(self, motion: Examined, bound: Array) -> float:
        """From the exact extrema inside the pieces, whatever jumps between them; see `Limit.slowing`.

        Parameters
        ----------
        motion : Examined
            The motion.
        bound : (m,) array
            What `Limit.array` returned [as its units].

        Returns
        -------
        float
            Factor of the duration [1].
        """
        return scale_of(float(self.piece_ratios(motion, bound).max()), self.order)


def _infinite_at_jumps(motion: Examined, order: int, extreme: Extreme, jumps: Flags, bound: Array) -> Extreme:
    """Extreme with infinite values at the largest jump of each joint that jumps in a derivative of this order."""
    trajectory = motion.trajectory
    size = np.where(jumps, np.abs(steps(trajectory, order)), 0.0)
    jumping = jumps.any(axis=0)
    when = trajectory.knots[size.argmax(axis=0)]
    infinite = np.where(np.isfinite(bound), np.inf, np.nan)
    return Extreme(
        np.where(jumping, np.inf, extreme.value),
        np.where(jumping, infinite, extreme.ratio),
        np.where(jumping, when, extreme.time),
    )


class ToolSpeedLimit(Limit):
    """A limit on the Euclidean norm of a part of the tool's twist: proved bounds judge it.

    Attributes
    ----------
    part : slice
        Rows of the twist (v, ω).
    """

    part: ClassVar[slice]
    order: ClassVar[int] = 1
    subject: ClassVar[str | None] = "tool"

    def rows(self, at: PathPoints, bound: Array) -> Array:
        """Norm of the path's twist per unit of s, over the bound; see `Limit.rows`.

        Parameters
        ----------
        at : PathPoints
            Points of the joint path.
        bound : (m,) array
            What `Limit.array` returned [as its units].

        Returns
        -------
        (k, m, order) array
            [as 1 over the monomials].
        """
        if not np.isfinite(bound[0]):
            return np.zeros((at.s.size, 1, 1))
        return np.asarray(np.linalg.norm(at.twist[:, self.part], axis=1)[:, None, None] / bound[0])

    def judge(self, motion: Examined, bound: Array) -> ToolExtreme:
        """The proved bound on the speed; see `Limit.judge`.

        Parameters
        ----------
        motion : Examined
            The motion.
        bound : (m,) array
            What `Limit.array` returned [as its units].

        Returns
        -------
        ToolExtreme
            Value, ratio and time.
        """
        value, time = self._proved(motion)
        return ToolExtreme(value, value / float(bound[0]) if np.isfinite(bound[0]) else float("nan"), time)

    @abstractmethod
    def _proved(self, motion: Examined) -> tuple[float, float]:
        """Proved bound on the speed over the motion, and when it is nearly reached [s]."""

    def piece_ratios(self, motion: Examined, bound: Array) -> Array:
        """The larger of the speeds at both ends of each piece over the bound; see `Limit.piece_ratios`.

        Parameters
        ----------
        motion : Examined
            The motion.
        bound : (m,) array
            What `Limit.array` returned [as its units].

        Returns
        -------
        (pieces, m) array
            Ratios [1].
        """
        speed = np.maximum(*(np.linalg.norm(side.motion[:, 0, self.part], axis=1) for side in motion.bounds.ends))
        return np.asarray(speed[:, None] / bound)
