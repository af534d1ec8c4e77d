"""Typed settings of suites: every key is declared once, with its default, unit and meaning."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Annotated, Any, ClassVar, TypeVar

import pydantic
from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, model_validator
from pydantic_core import CoreSchema
from pydantic_core.core_schema import no_info_before_validator_function

from optik.check import check_count, check_number, format_value
from optik.errors import InvalidInput, OptikError
from optik.plugins.files import find_nearest_name
from optik.registry import check_name, short_name

Model = TypeVar("Model", bound="Settings")

NAMED_KEYS = {
    "robot": ("optik.robots", "robot"),
    "set": ("benchmarks.problems", "problem set"),
    "solver": ("optik.ik", "IK method"),
    "law": ("planners.timing", "time law"),
}
"""Keys whose value is a name or the path of a file: group, and noun in errors. They have the same meaning in every kind."""


class Settings(BaseModel):
    """A table of a suite's file. Keys that are not declared are refused with the nearest one."""

    model_config = ConfigDict(extra="forbid", frozen=True, arbitrary_types_allowed=True, coerce_numbers_to_str=True)
    fixed: ClassVar[frozenset[str]] = frozenset()
    """Fields that a file must not set."""

    @classmethod
    def keys(cls) -> dict[str, Any]:
        """Return the fields by the keys of a file."""
        return {f.alias or name: f for name, f in cls.model_fields.items() if name not in cls.fixed}

    @model_validator(mode="before")
    @classmethod
    def _check_keys(cls, data: Any) -> Any:
        keys = cls.keys()
        need = [key for key, field in keys.items() if field.is_required()]
        check_keys(data, set(keys), "", set(need))
        return data


def key(meaning: str, default: Any = ..., unit: str = "", **more: Any) -> Any:
    """Declare a key: its meaning, its default and its unit."""
    return Field(default, description=meaning, json_schema_extra={"unit": unit}, **more)


def read(model: type[Model], data: Any, where: str) -> Model:
    """Read a table; errors of wrong use name the place of the wrong value."""
    try:
        return model.model_validate(data)
    except ValidationError as error:
        first = error.errors()[0]
        place = ": ".join([where, *(str(at) for at in first["loc"] if isinstance(at, str))])
        cause = first.get("ctx", {}).get("error")
        if isinstance(cause, InvalidInput):
            raise InvalidInput(f"{place}: {cause.argument}".rstrip(": "), cause.got, cause.expected) from None
        if isinstance(cause, OptikError):
            raise cause from None
        words = first["msg"].removeprefix("Input should be ").removeprefix("Value error, ")
        raise InvalidInput(place, format_value(first["input"], 60), words) from None


@contextmanager
def naming(where: str) -> Iterator[None]:
    """Add the place of the wrong value to errors of wrong use, because a suite may have several blocks."""
    try:
        yield
    except InvalidInput as error:
        raise InvalidInput(f"{where}: {error.argument}", error.got, error.expected) from error


# ---------------------------------------------------------------- types of values


def named(group: str, noun: str) -> BeforeValidator:
    """Return a name of a group, or the absolute path of a plug-in's file; no code is run."""
    return BeforeValidator(lambda value: check_name(group, value, noun))


RobotName = Annotated[str, named(*NAMED_KEYS["robot"])]
"""An arm."""

SetName = Annotated[str, named(*NAMED_KEYS["set"])]
"""A problem set."""

SolverName = Annotated[str, named(*NAMED_KEYS["solver"])]
"""An IK method."""

LawName = Annotated[str, named(*NAMED_KEYS["law"])]
"""A time law."""


def counted(least: int) -> BeforeValidator:
    """Return the type of a whole number of at least some value."""

    def check(value: Any) -> int:
        check_count(value, "", least)
        return int(value)

    return BeforeValidator(check)


Count = Annotated[int, counted(1)]
"""A whole number of at least 1."""

MaybeCount = Annotated[int | None, counted(1)]
"""A whole number of at least 1, or unlimited."""


def numbered(expected: str, *, above: float | None = None, least: float | None = None) -> BeforeValidator:
    """Return the type of a finite number inside a range."""
    return BeforeValidator(lambda value: check_number(value, "", expected, above=above, least=least))


def one_of(*known: str) -> BeforeValidator:
    """Return the type of a word from a list."""

    def check(value: Any) -> str:
        if value not in known:
            quoted = (repr(word) if "," in word else word for word in known)
            raise InvalidInput("", format_value(value, 60), f"one of {', '.join(quoted)}")
        return str(value)

    return BeforeValidator(check)


def _flag(value: Any) -> bool:
    if not isinstance(value, bool):
        raise InvalidInput("", format_value(value, 60), "true or false")
    return value


Flag = Annotated[bool, BeforeValidator(_flag)]
"""True or false."""


def _table(value: Any) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise InvalidInput("", type(value).__name__, "a table")
    return dict(value)


Options = Annotated[dict[str, Any], BeforeValidator(_table)]
"""Options of a method or a set, which checks them."""


def _listed(value: Any) -> tuple[Any, ...]:
    if not isinstance(value, list | tuple) or not value:
        raise InvalidInput("", format_value(value, 60), "a list that is not empty")
    return tuple(value)


LISTED = BeforeValidator(_listed)
"""Converts a list that is not empty to a tuple."""


def _increasing(values: tuple[int, ...]) -> tuple[int, ...]:
    if list(values) != sorted(set(values)):
        raise InvalidInput("", values, "whole numbers, each larger than the one before")
    return values


Budgets = Annotated[tuple[Count, ...], LISTED, AfterValidator(_increasing)]
"""Increasing numbers of iterations."""


def _three(values: Any) -> tuple[float, ...]:
    if not isinstance(values, list | tuple) or len(values) != 3:
        raise InvalidInput("", format_value(values, 60), "three numbers [m]")
    return tuple(check_number(x, "", "three numbers [m]") for x in values)


Three = Annotated[tuple[float, ...], BeforeValidator(_three)]
"""Three numbers."""

Joints = Annotated[tuple[Annotated[float, numbered("degrees or mm, one number a joint")], ...], LISTED]
"""Joint coordinates [degrees, mm]; their number is checked when the arm is loaded."""


class Entries:
    """A list of tables of a model, or one table, converted to entries with different labels."""

    def __init__(self, model: type[Any], *, single: bool = False, **about: Any) -> None:
        self.model, self._single, self._about = model, single, about

    def __get_pydantic_core_schema__(self, source: Any, handler: pydantic.GetCoreSchemaHandler) -> CoreSchema:
        return no_info_before_validator_function(self._read, handler(source))

    def _read(self, value: Any) -> Any:
        if self._single:
            return self._one(value)
        return check_labels(tuple(map(self._one, _listed(value))))

    def _one(self, value: Any) -> Any:
        return value if hasattr(value, "label") else read(self.model, value, "").entry(**self._about)


# ---------------------------------------------------------------- checks


def check_keys(data: Any, known: set[str], where: str, need: set[str] | None = None) -> None:
    """Raise InvalidInput unless data is a table with all required and only known keys."""
    if not isinstance(data, dict):
        raise InvalidInput(where, type(data).__name__, "a table")
    if unknown := sorted(set(data) - known):
        near = find_nearest_name(unknown[0], known)
        meant = f"{near!r}, or another of" if near else "keys out of"
        raise InvalidInput(where, f"the key {unknown[0]!r}", f"{meant} {', '.join(sorted(known))}")
    if missing := sorted((need or set()) - set(data)):
        raise InvalidInput(where, f"no {missing[0]!r}", f"the keys {', '.join(sorted(need or set()))}")


def check_different(values: list[str], where: str, what: str) -> None:
    """Raise InvalidInput unless all values are different."""
    if len(set(values)) != len(values):
        article = "an" if what[0] in "aeiou" else "a"
        raise InvalidInput(where, f"{what}s {values}", f"{article} {what} of its own for each")


def check_labels(entries: tuple[Any, ...]) -> tuple[Any, ...]:
    """Return entries; raise InvalidInput unless all of them have different labels."""
    check_different([entry.label for entry in entries], "", "label")
    return entries


def default_label(named: str) -> Callable[[dict[str, Any]], str]:
    """Return the default of a label: the name under another key."""
    return lambda given: short_name(given[named])
