"""The packages of the extra `bench`: without one, the import ends with the command that installs them."""

from optik.errors import MissingDependency

try:
    import plotly
    import polars
    import pydantic
except ModuleNotFoundError as error:
    raise MissingDependency(str(error.name), "a comparison", "bench") from None

__all__ = ["plotly", "polars", "pydantic"]
