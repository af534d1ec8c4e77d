"""Errors and warnings of optik; an expected failure is the status of a result, not an error."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

LONGEST_MESSAGE = 2000
"""Longest text of an error; a longer text is shortened in its middle."""

LONGEST_LIST = 120
"""Longest list of known names: a longer one is cut, and hidden beside a suggestion."""


class OptikError(Exception):
    """Base class of all errors raised by optik, planners and benchmarks."""

    def __init__(self, message: str = "") -> None:
        if len(message) > LONGEST_MESSAGE:
            half = LONGEST_MESSAGE // 2 - 20
            message = f"{message[:half]} ... {len(message) - 2 * half:,} letters ... {message[-half:]}"
        super().__init__(message)

    def __reduce__(self) -> tuple[Any, ...]:
        return _rebuild, (type(self), self.args, self.__dict__)


class InvalidInput(OptikError, ValueError):
    """An invalid argument.

    Attributes
    ----------
    argument, got, expected, advice : str
        Name of the argument, the value that was passed, and the values that are allowed, in words; and what to type instead,
        or empty.
    value : object
        The value that was passed.
    unit : str
        Its unit, ``rad`` or ``m``, if it is a number with one; else empty.
    """

    def __init__(self, argument: str, got: object, expected: str, *, advice: str = "", unit: str = "") -> None:
        self.argument, self.value, self.unit = argument, got, unit
        self.got = f"{got:.6g} {unit}" if unit else str(got)
        self.expected, self.advice = expected, advice
        super().__init__(f"{argument}: expected {expected}; got {self.got}{'; ' + advice if advice else ''}")


class Unsupported(InvalidInput):
    """An arm or a task that a method does not support."""


class RobotModelError(OptikError, ValueError):
    """A robot description that is not a serial arm, or is inconsistent.

    Attributes
    ----------
    robot, problem, file : str
        Name of the robot, what is wrong with it, and the file that was read, or an empty string.
    """

    def __init__(self, robot: str, problem: str, file: str = "") -> None:
        super().__init__(f"robot {robot!r}{f' in {file}' if file else ''}: {problem}")
        self.robot = robot
        self.problem = problem
        self.file = file


class RobotModelWarning(UserWarning):
    """A robot description that is read, but whose robot may not be the one that was meant.

    Attributes
    ----------
    robot, problem : str
        Name of the robot, and what may be wrong with it.
    """

    def __init__(self, robot: str, problem: str) -> None:
        super().__init__(f"robot {robot!r}: {problem}")
        self.robot = robot
        self.problem = problem

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.robot, self.problem)


class MovingMountWarning(RobotModelWarning):
    """Gravity that holds for one position of a joint between the root link and the base link only."""


class DegreesWarning(RobotModelWarning):
    """Position limits that seem to be in degrees where the file format has radians."""


class UnreadShapeWarning(RobotModelWarning):
    """Links whose collision shape cannot be read: plans with a scene are refused.

    Attributes
    ----------
    links : tuple of (str, str)
        Name of each link, and why its shape cannot be read.
    """

    def __init__(self, robot: str, problem: str, links: Iterable[tuple[str, str]]) -> None:
        super().__init__(robot, problem)
        self.links = tuple(links)

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.robot, self.problem, self.links)


class EnclosureWarning(RobotModelWarning):
    """Shapes of two links that are in contact in every sampled configuration: they enclose too much.

    Attributes
    ----------
    pairs : tuple of (str, str)
        Names of the links.
    """

    def __init__(self, robot: str, problem: str, pairs: Iterable[tuple[str, str]]) -> None:
        super().__init__(robot, problem)
        self.pairs = tuple((str(a), str(b)) for a, b in pairs)

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.robot, self.problem, self.pairs)


class AssumptionWarning(UserWarning):
    """Assumptions made while reading a file of another program; ``notes`` of the result lists them."""


class UnknownName(OptikError, LookupError):
    """An unknown name.

    Attributes
    ----------
    kind, name : str
        Kind of the named thing ("robot", "IK method", ...), and the unknown name.
    known, nearest : tuple of str
        All names that exist, and those with similar spelling, or those given as ``similar``.

    The message ends with the ``advice`` of the constructor.
    """

    def __init__(
        self, kind: str, name: str, known: Iterable[str], advice: str = "", similar: Iterable[str] = ()
    ) -> None:
        self.kind = kind
        self.name = name
        self.known = tuple(known)
        from difflib import get_close_matches

        spelled = {each.lower(): each for each in self.known}
        typed = str(name).lower()
        close = [typed] if typed in spelled else get_close_matches(typed, spelled, n=3, cutoff=0.45)
        close = close or [each for each in spelled if typed and each.startswith(typed)]
        self.nearest = tuple(similar) or tuple(spelled[each] for each in close)
        hint = f"did you mean {' or '.join(self.nearest)}?" if self.nearest else ""
        listed = ", ".join(self.known) or "none"
        if len(listed) > LONGEST_LIST:
            listed = "" if hint or advice else f"{listed[:LONGEST_LIST].rpartition(', ')[0]}, …"
        listed = listed and f"there are: {listed}"
        super().__init__("; ".join(filter(None, (f"unknown {kind} {name!r}", f"{hint} {listed}".strip(), advice))))

    def __str__(self) -> str:  # a LookupError would show its message in quotes
        return str(self.args[0])


class MissingDependency(OptikError, ImportError):
    """A missing optional package.

    Attributes
    ----------
    package, needed_by : str
        The package that could not be imported, and the feature that needs it.

    The message ends with the installation: an ``extra`` of this distribution, or ``how`` if pip cannot install it.
    """

    def __init__(self, package: str, needed_by: str, extra: str | None, how: str = "") -> None:
        how = how or (f"pip install 'optik-toolkit[{extra}]'" if extra else f"install the package {package}")
        super().__init__(f"{needed_by} needs the package {package}, which is not installed: {how}")
        self.package = package
        self.needed_by = needed_by


class NoSolution(OptikError, RuntimeError):
    """Use of a result that does not exist because planning failed.

    Attributes
    ----------
    s : float or None
        Path parameter at which planning failed, in the path's unit (metres; radians for a pure rotation).
    joint : str or None
        Joint whose limit is violated, or None.
    reason, advice : str
        Why it failed, with numbers, and what to change.
    """

    def __init__(self, reason: str, *, s: float | None = None, joint: str | None = None, advice: str = "") -> None:
        super().__init__(f"{reason}{'; try: ' + advice if advice else ''}")
        self.s = s
        self.joint = joint
        self.reason = reason
        self.advice = advice


class InvalidMotion(NoSolution):
    """A motion is not written or executed, because it violates a limit, its path or its clearance.

    It has the attributes of `NoSolution`, and:

    Attributes
    ----------
    allow : tuple of str
        The words that permit it: ``allow=`` in Python, ``--allow`` on the command line.
    """

    def __init__(
        self, reason: str, allow: Iterable[str], *, s: float | None = None, joint: str | None = None, advice: str = ""
    ) -> None:
        self.allow = tuple(allow)
        permission = f"allow={self.allow!r}, which permits it"
        super().__init__(reason, s=s, joint=joint, advice=f"{advice}; or {permission}" if advice else permission)


class OutputError(OptikError, OSError):
    """A file or folder that cannot be written, or that has other content than expected.

    Attributes
    ----------
    path, problem : str
        The file or folder, and what is wrong with it.
    """

    def __init__(self, path: object, problem: str) -> None:
        super().__init__(f"{path}: {problem}")
        self.path = str(path)
        self.problem = problem

    def __str__(self) -> str:
        return str(self.args[0])


def _rebuild(kind: type[OptikError], args: tuple[Any, ...], state: dict[str, Any]) -> OptikError:
    error = kind.__new__(kind)
    error.args = args
    error.__dict__.update(state)
    return error
