"""Compilation of hot loops by Numba: IEEE values for division by zero, no fast-math, machine code cached or shipped.

Numba's dispatcher is made faster: no unused wrappers, one version for all literal integers, no garbage collector.
"""

from __future__ import annotations

import gc
import inspect
import os
import sys
import time
from collections.abc import Callable
from functools import cached_property
from typing import Any, ClassVar, TypeVar

from numba.core import config, types
from numba.core.dispatcher import _FunctionCompiler  # type: ignore[attr-defined]
from numba.core.registry import CPUDispatcher

from optik.compiled import archive
from optik.compiled.cache import MOST_OPT, KernelCache

config._config_fname = os.devnull  # a .numba_config.yaml in the working folder could name a folder of code to run
config.reload_config()

F = TypeVar("F", bound=Callable[..., Any])
"""Type of the function: the type checker sees the signature of the compiled function."""
QUIET_SECONDS = 2.0
"""Time of compilation after which a process says that it compiles [s]."""
SECONDS_A_LINE = 10.0
"""Time of compilation between two lines where there is no terminal [s]."""
FIRST_USE = "optik: compiling on first use, about a minute; later runs use the cache (help: `optik kernels`)"
"""The line of a process that compiles, once."""
NOT_SHIPPED = "optik: this installation has no compiled kernels for this platform and Python"
"""The line before it, if that is the reason."""


def compiled(function: F) -> F:
    """Compile a function over arrays on its first call."""
    return _jit(function, False)


def parallel(function: F) -> F:
    """Compile like `compiled`, into code that releases Python's global lock, so that threads can run it in parallel."""
    return _jit(function, True)


def _jit(function: F, nogil: bool) -> F:
    if config.DISABLE_JIT:
        return function
    kernel: Any = Kernel(function, targetoptions={"nogil": nogil})
    kernel._cache = KernelCache(kernel)  # what njit(cache=True) would put there
    result: F = kernel
    return result


def inlined(function: F) -> F:
    """Compile a helper into every kernel that calls it, without fast-math.

    With fast-math, LLVM fuses products and sums differently for one lane and for many.
    """
    helper: Any = function if config.DISABLE_JIT else Helper(function)
    result: F = helper
    return result


class Kernel(CPUDispatcher):  # type: ignore[misc]
    """A compiled function."""

    _compiler: Any

    options: ClassVar[dict[str, bool]] = {"no_cfunc_wrapper": True}

    def __init__(self, py_func: Any, locals: Any = None, targetoptions: Any = None, **others: Any) -> None:
        py_func.__signature__ = inspect.signature(py_func)  # which Numba asks for three times
        given = {"nopython": True, "boundscheck": None, "error_model": "numpy"} | self.options | (targetoptions or {})
        super().__init__(py_func, locals, given, **others)
        self._compiler = _Compiler(py_func, self.targetdescr, given, self.locals, self._compiler.pipeline_class)

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """Resolve a call by another kernel; literal integers are plain integers, so that no version is compiled for each."""
        return super().get_call_template([_plain(a) for a in args], {name: _plain(a) for name, a in kws.items()})


class Helper(Kernel):
    """A function that is compiled into the kernels that call it."""

    options: ClassVar[dict[str, bool]] = Kernel.options | {"no_cpython_wrapper": True, "forceinline": True}

    def __call__(self, *args: Any) -> Any:
        """Run as a kernel: without its wrapper, the code of a helper cannot be called from Python."""
        return self._kernel(*args)

    @cached_property
    def _kernel(self) -> Kernel:
        """The same function with a wrapper, compiled once for each signature."""
        return Kernel(self.py_func)


def _plain(kind: Any) -> Any:
    return kind.literal_type if isinstance(kind, types.IntegerLiteral) else kind


class _Process:
    """State of compilation in this process; Numba's lock lets one thread compile at a time."""

    depth: int = 0  # functions that are being compiled, each because the one before calls it
    level: Any = None  # Numba's optimisation level before the outermost compilation
    seconds: float = 0.0  # of all earlier compilations [s]
    begin: float = 0.0  # of the outermost compilation [s]
    due: float = float("inf") if os.environ.get("OPTIK_COMPILES") == "quiet" else 0.0  # the next line [s]


class _Compiler(_FunctionCompiler):  # type: ignore[misc]
    """Compiler of one function."""

    def compile(self, args: Any, return_type: Any) -> Any:
        """Compile for types of arguments, without Python's garbage collector, which would find nothing."""
        if _Process.depth == 0:
            _Process.level, _Process.begin = config.OPT, time.monotonic()
        before, collects = config.OPT, gc.isenabled()
        low = type(_Process.level)(min(_Process.level, MOST_OPT))
        _Process.depth += 1
        _tell(self.py_func.__name__)
        try:
            gc.disable()
            config.OPT = _Process.level if self.targetoptions.get("nogil") else low
            return super().compile(args, return_type)
        finally:
            config.OPT = before
            if collects:
                gc.enable()
            _Process.depth -= 1
            _Process.seconds += 0.0 if _Process.depth else time.monotonic() - _Process.begin
            _tell("")


def _tell(name: str) -> None:
    """Show a long compilation: `FIRST_USE`, then on a terminal one line that is replaced and removed, elsewhere more lines."""
    seconds = _Process.seconds + (time.monotonic() - _Process.begin if _Process.depth else 0.0)
    if seconds <= QUIET_SECONDS or sys.stderr is None:
        return
    from multiprocessing import parent_process

    words, terminal = f"optik: compiling, {seconds:.0f} s{name and f': {name}'}"[:70], sys.stderr.isatty()
    if seconds >= _Process.due and parent_process() is None:  # not a worker
        first = f"{NOT_SHIPPED}\n" * isinstance(archive.open_archive(), str) + FIRST_USE
        if not (_Process.due and terminal):
            print(words if _Process.due else first, file=sys.stderr, flush=True)
        _Process.due = seconds + SECONDS_A_LINE
    if terminal:
        print(f"\r\x1b[K{words if _Process.depth else ''}", end="", file=sys.stderr, flush=True)
