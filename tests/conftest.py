"""What every test shares: property tests that draw the same examples in every run and are never timed."""

import gc
import os
from collections.abc import Iterator
from zlib import crc32

import pytest
from hypothesis import HealthCheck, settings

from tests.outside import give

os.environ.setdefault("OPTIK_COMPILES", "quiet")  # the tests read what processes write to the error stream
ALIKE = {
    "deadline": None,
    "derandomize": True,
    "database": None,
    "suppress_health_check": [HealthCheck.function_scoped_fixture],
}
settings.register_profile("optik", **ALIKE, max_examples=25)
settings.register_profile("soak", **ALIKE, max_examples=60)


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--plugin", action="append", default=[], metavar="GROUP=PATH", help="Test this file as one of ours."
    )
    parser.addoption("--part", metavar="K/N", help="Run part K of N, which are divided by the names of the tests.")


def pytest_configure(config: pytest.Config) -> None:
    for option in config.getoption("--plugin"):
        try:
            give(option)
        except ValueError as error:
            raise pytest.UsageError(str(error)) from None
    settings.load_profile("soak" if config.option.markexpr.startswith("soak") else "optik")


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Iterator[None]:
    """Nothing of what is collected is garbage: looking for some takes a third of the time."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    if part := config.getoption("--part"):
        k, count = map(int, part.split("/"))
        mine = {item for item in items if (crc32(item.nodeid.encode()) - k) % count == 0}
        config.hook.pytest_deselected(items=[item for item in items if item not in mine])
        items[:] = [item for item in items if item in mine]
