"""What every test shares: property tests that draw the same examples in every run and are never timed."""

import pytest
from hypothesis import settings

from tests.outside import give

settings.register_profile("optik", deadline=None, derandomize=True, database=None, max_examples=60)
settings.load_profile("optik")


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--plugin", action="append", default=[], metavar="GROUP=PATH", help="Test this file as one of ours."
    )


def pytest_configure(config: pytest.Config) -> None:
    for option in config.getoption("--plugin"):
        try:
            give(option)
        except ValueError as error:
            raise pytest.UsageError(str(error)) from None
