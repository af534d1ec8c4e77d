"""Kinds of limits: how a limit is given and filed, the rows that it adds to a time law, and its judgement of a motion."""

from __future__ import annotations

from abc import ABC, abstractmethod
from numbers import Real
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from optik.arm.limits import check_positive, freeze
from optik.arm.plain import numbers_to_list, read_numbers
from optik.arm.robot import Robot
from optik.check import check_number, real_array
from optik.errors import InvalidInput
from optik.types import Array
from planners.limits.inputs import Extreme, LimitedMotion, LimitedPath, PathPoints, ToolExtreme

PAIR = "a pair (lower, upper), lower < 0 < upper, each a finite number or one for each joint"
"""Description of a valid pair in error messages; both sides may be infinite for a joint without a limit."""


def is_pair(value: Any) -> bool:
    """Return whether a limit is a pair (lower, upper), and not one number for each of two joints."""
    several = (list, tuple, np.ndarray)
    if not isinstance(value, several) or (isinstance(value, np.ndarray) and value.ndim == 0) or len(value) != 2:
        return False
    first, second = value
    if isinstance(first, several) or isinstance(second, several):
        return True
    return isinstance(first, Real) and bool(first < 0.0)


def check_pair(value: Any, argument: str) -> Array | float:
    """Return a pair as `MotionLimits` stores it: a number or (n,) array if its sides are equal, or a (2,) or (2, n) array."""
    lower, upper = (real_array(x, argument, PAIR) for x in value)
    if max(lower.ndim, upper.ndim) > 1 or (lower.ndim == upper.ndim == 1 and lower.shape != upper.shape):
        raise InvalidInput(argument, f"a pair of shapes {lower.shape} and {upper.shape}", PAIR)
    lower, upper = np.broadcast_arrays(lower, upper)
    if not ((lower < 0.0) & (upper > 0.0)).all():
        came = f"({', '.join(np.array2string(x, precision=6, threshold=8) for x in (lower, upper))})"
        raise InvalidInput(argument, came, PAIR)
    if (np.isinf(lower) != np.isinf(upper)).any():
        raise InvalidInput(argument, "a pair with one infinite side", PAIR)
    if (lower == -upper).all():
        return freeze(upper, argument) if upper.ndim else float(upper)
    return freeze(np.stack([lower, upper]), argument)


def sides(limit: Array) -> tuple[Array, Array]:
    """Return the lower and the upper side of a limit."""
    return (-limit, limit) if limit.ndim == 1 else (limit[0], limit[1])


def middle_and_half(lower: Array, upper: Array) -> tuple[Array, Array]:
    """Return the middles of ranges and half their widths; those of a range without ends are 0 and infinity."""
    free = np.isinf(upper)
    low, high = np.where(free, 0.0, lower), np.where(free, 0.0, upper)
    return 0.5 * (low + high), np.where(free, np.inf, 0.5 * (high - low))


def symmetric_limit(limit: Array) -> Array:
    """Return the largest symmetric limit that both sides allow."""
    return limit if limit.ndim == 1 else np.minimum(-limit[0], limit[1])


def ratio_to_limit(values: Array, limit: Array) -> Array:
    """Return the ratios of values to the limit on their side."""
    if limit.ndim == 1:
        return np.asarray(np.abs(values) / limit)
    return np.asarray(values / np.where(values < 0.0, limit[0], limit[1]))


class Limit(ABC):
    """Base of a kind of limit.

    A further limit is a subclass in a file of its own in this folder, named by ``METHOD``, or an object that is registered
    with `planners.limits.register`. The file's stem is its ``name``: its key in motion files, in
    ``MotionLimits(extra=...)``, in `TimeLaw.enforced` and in certificates.

    A limit with several numbers of different meaning is a frozen record; `RecordLimit` is the base of its kind.

    Attributes
    ----------
    name : str
        The key.
    units : tuple of str
        Unit of the limit for revolute and for prismatic joints; a limit of the whole arm repeats its one unit.
    order : int
        Power of the time scale: a motion stretched by c has 1 / c**order of the value. Also the order of its rows.
    subject : str or None
        Part that the one limit of the whole arm is on, such as ``"tool"``; None for a limit on every joint.
    sided : bool
        Whether the limit may be a pair (lower, upper). If so, all methods also take a limit of shape (2, n), lower first.
    homogeneous : bool
        Whether the whole value scales with time; False for the torque, which includes gravity.
    on_goods : bool
        Whether it is a limit on the payload: in a program with payloads it applies only in sections with a payload.
    """

    name: ClassVar[str]
    units: ClassVar[tuple[str, str]]
    order: ClassVar[int]
    subject: ClassVar[str | None] = None
    sided: ClassVar[bool] = False
    homogeneous: ClassVar[bool] = True
    on_goods: ClassVar[bool] = False

    # ------------------------------------------------------------ the limit, as given and in files

    def check(self, value: Any) -> Any:
        """Return a limit as `MotionLimits` stores it: a float, or a read-only array.

        Parameters
        ----------
        value : scalar or (n,) array, or a pair of them
            The limit [as `units`]; a scalar for a limit of the whole arm.

        Returns
        -------
        float, (n,), (2,) or (2, n) array
            The limit [as `units`]; the last two for a pair, lower first.

        Raises
        ------
        InvalidInput
            A value that is not a number above 0, a pair for a limit without sides, or a pair without 0 between its sides.
        """
        if self.subject is not None:
            return check_number(value, self.name, f"a {self.name.replace('_', ' ')} above 0", above=0.0)
        if is_pair(value):
            if not self.sided:
                expected = f"one number above 0, or one for each joint: {self.name} has no two sides"
                raise InvalidInput(self.name, "a pair (lower, upper)", expected)
            return check_pair(value, self.name)
        kept = check_positive(value, np.size(value), self.name)
        return kept if np.ndim(value) else float(kept[0])

    def array(self, value: ArrayLike | None, n: int) -> Array:
        """Return a limit as an array, one entry for each subject.

        Parameters
        ----------
        value : scalar or (n,) array, or a pair of them, or None
            Result of `check` [as `units`]; None where nothing is limited.
        n : int
            Number of joints.

        Returns
        -------
        (n,) array, (2, n) for a pair, or (1,) for a limit of the whole arm
            [as `units`], infinity without a limit; read-only.

        Raises
        ------
        InvalidInput
            A length other than n.
        """
        if self.sided and is_pair(value):
            pair = np.asarray(value, dtype=np.float64)
            if pair.shape not in ((2,), (2, n)):
                raise InvalidInput(self.name, f"a pair of {pair.shape[-1]} numbers each", f"numbers or {n} of them")
            return freeze(np.broadcast_to(pair.reshape(2, -1), (2, n)), self.name)
        return check_positive(np.inf if value is None else value, 1 if self.subject is not None else n, self.name)

    def to_plain(self, value: ArrayLike | None) -> Any:
        """Return a limit as plain data for files, which `from_plain` reads back to the last bit.

        Parameters
        ----------
        value : scalar or (n,) array, or a pair of them, or None
            Result of `check` [as `units`].

        Returns
        -------
        float, list or None
            Plain data.
        """
        return None if value is None else numbers_to_list(value)

    def from_plain(self, data: Any, n: int) -> Array | float | None:
        """Return the limit from the data of `to_plain`.

        Parameters
        ----------
        data : float, list or None
            Plain data.
        n : int
            Number of joints.

        Returns
        -------
        float, (n,), (2,) or (2, n) array, or None
            The limit [as `units`]; a pair is two lists of numbers, or two numbers with the first negative.

        Raises
        ------
        InvalidInput
            Data that are not a limit.
        """
        if data is None:
            return None
        where = f"limits.{self.name}"
        if self.sided and isinstance(data, list) and len(data) == 2 and (data[0] == "-inf" or is_pair(data)):
            return read_numbers(data, (2, n) if isinstance(data[0], list) else (2,), where)
        if self.subject is None and isinstance(data, list):
            return read_numbers(data, (n,), where)
        return float(read_numbers(data, (), where))

    def scaled(self, value: Any, factor: float) -> Any:
        """Return a limit multiplied by a factor.

        Parameters
        ----------
        value : scalar or (n,) array, or a pair of them, or a record
            Result of `check` [as `units`].
        factor : float
            The factor [1].

        Returns
        -------
        float, array or record
            The scaled limit [as `units`].
        """
        return factor * np.asarray(value) if np.ndim(value) else factor * float(value)

    # ------------------------------------------------------------ what it needs

    def is_given(self, limit: Any) -> bool:
        """Return whether a limit is finite anywhere.

        Parameters
        ----------
        limit : array or record
            Result of `array` [as `units`].

        Returns
        -------
        bool
        """
        return bool(np.isfinite(limit).any())

    def check_robot(self, robot: Robot, limit: Any) -> None:
        """Raise InvalidInput for an arm without what the limit needs, such as its shapes.

        Parameters
        ----------
        robot : Robot
            The arm.
        limit : array or record
            Result of `array` [as `units`].
        """
        return

    def check_still(self, joint_path: LimitedPath, limit: Any) -> None:
        """Raise NoSolution for a joint path on which the limit is exceeded however slowly the arm moves.

        Parameters
        ----------
        joint_path : LimitedPath
            The joint path.
        limit : array or record
            Result of `array` [as `units`].
        """
        return

    # ------------------------------------------------------------ time laws

    @abstractmethod
    def rows(self, at: PathPoints, limit: Any) -> Array:
        """Return the coefficients of a value over its limit, at points of a joint path.

        Parameters
        ----------
        at : PathPoints
            Points of the joint path.
        limit : (m,) or (2, m) array, or record
            Result of `array` [as `units`].

        Returns
        -------
        (k, m, order) array, or of more columns
            [as 1 over the monomials] of `planners.trajectory.curve.monomials`: ṡ for order 1, s̈ and ṡ² for order 2,
            s⃛, ṡ s̈ and ṡ³ for order 3; or (k, m, 4) and (k, m, 6) for the full sets of orders 2 and 3. The limit is
            respected where |rows · monomials| ≤ 1.
        """

    # ------------------------------------------------------------ judgement

    def subjects(self, robot: Robot, limit: Any = None) -> tuple[str, ...]:
        """Return the names of the limited joints, or of the limited part.

        Parameters
        ----------
        robot : Robot
            The arm.
        limit : array or record, optional
            Result of `array` [as `units`].

        Returns
        -------
        tuple of str
            The joints' names, or the one `subject`.
        """
        return robot.joint_names if self.subject is None else (self.subject,)

    @abstractmethod
    def judge(self, motion: LimitedMotion, limit: Any) -> Extreme | ToolExtreme:
        """Return the peak value over a motion: exact or a proved bound, not the largest of samples.

        Parameters
        ----------
        motion : LimitedMotion
            The motion.
        limit : (m,) or (2, m) array, or record
            Result of `array` [as `units`].

        Returns
        -------
        Extreme or ToolExtreme
            The first for a limit on every joint, the second for one on the whole arm.
        """

    @abstractmethod
    def piece_ratios(self, motion: LimitedMotion, limit: Any) -> Array:
        """Return the peak ratio to the limit on each piece of a motion, which shows the active constraint there.

        Parameters
        ----------
        motion : LimitedMotion
            The motion.
        limit : (m,) or (2, m) array, or record
            Result of `array` [as `units`].

        Returns
        -------
        (pieces, m) array
            Ratios [1]; 0 without a limit.
        """

    def excess(self, motion: LimitedMotion, limit: Any) -> Array:
        """Return the factors by which the law `optimal` tightens the rows of second and third order on each piece.

        Without an own method they are `piece_ratios`. A limit with a static part returns the dynamic part of each row over the
        room that its static part leaves.

        Parameters
        ----------
        motion : LimitedMotion
            The motion.
        limit : (m,) or (2, m) array, or record
            Result of `array` [as `units`].

        Returns
        -------
        (pieces, rows) array
            Factors [1]; the row is tightened where they exceed 1.
        """
        return self.piece_ratios(motion, limit)

    def stretch_factor(self, motion: LimitedMotion, limit: Any) -> float:
        """Return the least factor by which a motion is stretched in time to respect the limit.

        A limit with a part that stretching does not change (the torque of gravity) overrides this method, and returns
        infinity if no factor suffices.

        Parameters
        ----------
        motion : LimitedMotion
            The motion.
        limit : (m,) or (2, m) array, or record
            Result of `array` [as `units`].

        Returns
        -------
        float
            Below 1 if the motion can be faster; 0 if nothing limits it.
        """
        if not self.is_given(limit):
            return 0.0
        ratio = float(np.nanmax(self.judge(motion, limit).ratio))
        return scale_of(ratio, self.order)


def scale_of(ratio: float, order: int) -> float:
    """Return the time scale at which a value proportional to 1 / scale**order is at its limit."""
    return float(max(ratio ** (1.0 / order), np.nextafter(1.0, 2.0) if ratio > 1.0 else 0.0))


METHOD_BASE = Limit
"""Base class of the METHOD of every limit."""
