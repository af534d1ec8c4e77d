"""The one way a hot loop is compiled: kept on disk for as long as all that it depends on is the same, and no longer."""

import cProfile
import ctypes
import gc
import importlib
import os
import pickle
import stat
import subprocess
import sys
import tempfile
from pathlib import Path
from types import SimpleNamespace

import numba
import numpy as np
import pytest
from numba import typeof, types
from numba.extending import is_jitted

import optik.compiled.cache
from optik.compiled import compiled, inlined, kernel
from optik.compiled.cache import Opaque, fingerprint
from optik.compiled.kernel import FIRST_USE, NOT_SHIPPED, Helper, Kernel
from tests import forks
from tests.oracles import REPOSITORY

INNER = "from optik.compiled import compiled\n\n@compiled\ndef inner(x):\n    return {} * x\n"
OUTER = "from inner import inner\nfrom optik.compiled import compiled\n\n@compiled\ndef outer(x):\n    return inner(x) + 1.0\n"

RUN = """
from numba.core import event
compilations = event.RecordingListener()
event.register("numba:compile", compilations)
from outer import outer
print(outer(1.0), sum(e.is_start for _, e in compilations.buffer))
"""


def start(folder, env=None, **options):
    """A fresh process in a folder; it prints what `outer` computes, and how many functions were compiled for it."""
    kept = {k: v for k, v in os.environ.items() if k not in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME")}
    path = {"PYTHONPATH": os.pathsep.join([str(REPOSITORY), str(folder)])}
    return forks.start(RUN, cwd=folder, env=kept | path | (env or {}), **options)


def finish(process):
    """Value, number of compiled functions, and warnings of a process."""
    done = process()
    assert done.returncode == 0, done.stderr
    value, count = done.stdout.split()
    return float(value), int(count), done.stderr


def write_two(folder, factor="2.0"):
    (folder / "inner.py").write_text(INNER.format(factor))
    (folder / "outer.py").write_text(OUTER)


def kept_in(folder):
    return sorted(folder.rglob("*.nbk"))


def test_a_changed_function_is_compiled_anew_into_its_callers_and_nothing_else_is(tmp_path):
    write_two(tmp_path)
    assert finish(start(tmp_path)) == (3.0, 2, "")
    inner = tmp_path / "inner.py"
    inner.write_text('"""A file."""\n\n\n' + INNER.format("2.0") + "\n\ndef another():\n    return 1\n")
    os.utime(inner, (1, 1))
    assert finish(start(tmp_path, {"PYTHONHASHSEED": "7"})) == (3.0, 0, "")
    inner.write_text(INNER.format("5.0"))
    assert finish(start(tmp_path)) == (6.0, 2, "")
    assert [f.name.split("-")[0] for f in kept_in(tmp_path)] == ["inner.inner", "outer.outer"]  # written over


def test_processes_may_compile_at_once(tmp_path):
    write_two(tmp_path)
    cache = {"NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    for process in [start(tmp_path, cache) for _ in range(2)]:
        assert finish(process)[::2] == (3.0, "")
    assert finish(start(tmp_path, cache)) == (3.0, 0, "")
    assert len(kept_in(tmp_path)) == len([f for f in (tmp_path / "cache").rglob("*") if f.is_file()]) == 2  # no halves


# ---------------------------------------------------------------- what a kernel depends on
FILES = {
    "far": """
from enum import IntEnum
from typing import NamedTuple
import numpy as np
from optik.compiled import compiled, inlined, parallel

FACTOR = 2.0
TABLE = np.zeros(2)
PAIR = (1, ("a", 2.5))
class Kind(IntEnum):
    A = 1
class Fields(NamedTuple):
    first: float
    second: float
@compiled
def helper(x: float, more=1.0, *, scale=3) -> float:
    'What it does.'
    try:
        least = [FACTOR * y for y in (x,)][0]
        more = more + 1.0
    except ValueError:
        least = scale
    return least + more
@inlined
def small(x):
    return x + 3.0
def closed(n):
    @compiled
    def inside(x):
        return x + n
    return inside
inside = closed(6)
""",
    "odd": """
import numpy as np
from numba import types
from numba.extending import intrinsic, overload, register_jitable
from beside import LESS, KIND, other
@register_jitable
def taught(x):
    return x + 4.0
def plain(x):
    return x
@overload(plain)
def _plain(x):
    return lambda x: other(x) - LESS
def _own(typingctx, x):
    def generate(context, builder, signature, arguments):
        return builder.fadd(*arguments, *arguments)
    return KIND(types.float64), generate
own = intrinsic(_own)
""",
    "beside": """
from numba import types
from optik.compiled import compiled
LESS = 5.0
KIND = types.float64
@compiled
def other(x):
    return x + 1.0
""",
    "near": """
import far
from optik.compiled import compiled
@compiled
def through(x):
    if str(x) in {"north", "south", "east"}:
        return 0.0
    return far.helper(x) + far.TABLE[0] + far.PAIR[0] + far.Kind.A
""",
    "kernel": """
from far import Fields, inside, small
from odd import own, plain, taught
from near import through
from optik.compiled import compiled
@compiled
def kernel(x):
    'What it says.'
    f = Fields(x, x)
    return through(x) + small(x) + taught(x) + plain(x) + own(x) + inside(x) + f.first
""",
}


@pytest.fixture(name="written")
def _written(tmp_path, monkeypatch):
    """Fingerprint of `kernel`, read anew from files of which one may differ."""
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    monkeypatch.syspath_prepend(str(tmp_path))

    def write(file="far", old="", new=""):
        assert old in FILES[file]
        for name, text in FILES.items():
            (tmp_path / f"{name}.py").write_text(text.replace(old, new) if name == file and old else text)
            sys.modules.pop(name, None)
        importlib.invalidate_caches()
        try:
            return fingerprint(importlib.import_module("kernel").kernel, ())
        finally:
            for name in FILES:
                sys.modules.pop(name, None)

    return write


@pytest.mark.parametrize(
    ("file", "old", "new"),
    [
        ("far", "FACTOR = 2.0", "FACTOR = 2.5"), ("far", "FACTOR = 2.0", "FACTOR = 2"), ("far", "A = 1", "A = 2"),
        ("far", "np.zeros(2)", "np.ones(2)"), ("far", "np.zeros(2)", "np.zeros(2, np.int64)"),
        ("far", '("a", 2.5)', '("a", 2.6)'), ("far", "first: float\n    second", "second: float\n    first"),
        ("far", "more=1.0", "more=1.5"), ("far", "least + more", "least - more"), ("far", "ValueError", "KeyError"),
        ("far", "return x + 3.0", "return x + 3.5"), ("far", "@inlined", "@compiled"), ("far", "*, scale=3", "*, scale=4"),
        ("far", "@compiled\ndef helper", "@parallel\ndef helper"), ("odd", "return x + 4.0", "return x + 4.5"),
        ("odd", "other(x) - LESS", "other(x) + LESS"), ("odd", "fadd", "fmul"), ("beside", "LESS = 5.0", "LESS = 5.5"),
        ("beside", "x + 1.0", "x + 1.5"), ("beside", "types.float64", "types.float32"), ("near", "north", "west"),
        ("far", "        more = more + 1.0\n    except ValueError:\n        least = scale\n",
         "    except ValueError:\n        least = scale\n    else:\n        more = more + 1.0\n"),
        ("far", "closed(6)", "closed(7)"), ("near", "far.helper(x)", "far.small(x)"),
        ("kernel", "@compiled", "from optik.compiled import parallel\n@parallel"),
    ],
)  # fmt: skip
def test_a_kernel_depends_on(written, file, old, new):
    assert written(file, old, new) != written()


@pytest.mark.parametrize(
    ("file", "old", "new"),
    [
        ("near", "import far", "# A comment.\n\nimport far"),
        ("near", "return far.helper(x)", "# why\n    return far.helper(x)"),
        ("near", "import far", "import far\nOTHER = 3.0\n@far.compiled\ndef unused(x):\n    return OTHER * x\n"),
        ("kernel", "'What it says.'", "'What it says now.'"),
        ("kernel", "def kernel(x)", "def kernel(x: 'float') -> 'float'"),
        ("far", "'What it does.'", "'What it does now.'"),
        ("far", "x: float", "x: 'float'"),
        ("odd", "import numpy as np", "# A comment beside what teaches Numba.\nimport numpy as np"),
        ("far", "", ""),
    ],
)
def test_a_kernel_does_not_depend_on(written, file, old, new):
    assert written(file, old, new) == written()


def without_file(text):
    inside = {"__name__": "made"}
    exec(text, inside)
    return compiled(inside["f"])


def test_a_docstring_that_the_code_returns_is_code():
    def made(text):
        return fingerprint(without_file(f"def f():\n    '{text}'\n    return '{text}'\n"), ())

    assert made("one") != made("two")


def test_a_kernel_depends_on_how_numba_compiles(monkeypatch):
    before = fingerprint(compiled(doubled), ())
    monkeypatch.setattr("numba.core.config.BOUNDSCHECK", 1)
    assert fingerprint(compiled(doubled), ()) != before


def test_a_kernel_does_not_depend_on_patches_of_python_and_numpy(monkeypatch):
    spec = importlib.util.spec_from_file_location("another", optik.compiled.cache.__file__)

    def print_with(versions):
        with monkeypatch.context() as change:
            for name, value in versions.items():
                change.setattr(name, value)
            another = importlib.util.module_from_spec(spec)
            spec.loader.exec_module(another)
        return another.fingerprint(compiled(doubled), ())

    before, major = print_with({}), np.__version__.split(".")[0]
    assert print_with({"numpy.__version__": f"{major}.99.1", "sys.version": "3.99 (another build)"}) == before
    others = ("numba.__version__", "0.1"), ("llvmlite.__version__", "0.1"), ("numpy.__version__", "99.1.0")
    magic = ("importlib.util.MAGIC_NUMBER", b"1234")
    assert len({before, *(print_with(dict([other])) for other in (*others, magic))}) == 5


def test_a_profiler_changes_nothing():
    kernel = compiled(doubled)
    before = fingerprint(kernel, ())
    with cProfile.Profile():  # Numba changes the flags of the code then
        kernel(1.0), kernel(2.0)
    assert fingerprint(kernel, ()) == before


def test_a_function_without_a_file_is_compiled_and_kept_nowhere(recwarn):
    kernel = without_file("def f(x):\n    return 2.0 * x\n")
    assert kernel(1.5) == 3.0
    assert kernel._cache.cache_path is None
    assert not recwarn.list


def test_a_function_that_is_passed_is_compiled_in():
    def calls(f, x):
        return f(x)

    def adds(n):
        def f(x):
            return x + n

        return typeof(compiled(f))

    kernel = compiled(calls)
    prints = [fingerprint(kernel, (adds(n),)) for n in (1, 2, 1)]
    assert prints[0] == prints[2] != prints[1]
    with pytest.raises(Opaque):
        fingerprint(kernel, (types.Opaque("a thing at 0x7f00"),))


def test_the_order_of_a_set_does_not_count():
    def prints(constant):
        def kernel():
            return constant

        return fingerprint(compiled(kernel), ())

    one, other = frozenset([0, 8]), frozenset([8, 0])
    assert list(one) != list(other)
    assert prints(one) == prints(other) != prints(frozenset([0, 9]))


def test_a_function_may_call_itself():
    @compiled
    def factorial(n):
        return n * factorial(n - 1) if n > 1 else 1

    assert fingerprint(factorial, ()) == fingerprint(factorial, ())
    assert factorial(5) == 120


def test_modules_and_functions_may_reach_each_other_in_a_circle(written):
    circle = "import far\nimport sys\nfar.near = sys.modules['near']\n"
    called = "far.near.far.near.through(x) + far.helper(x)"
    original = FILES["near"]
    FILES["near"] = original.replace("import far\n", circle).replace("far.helper(x)", called)
    try:
        assert written() == written() != written("near", "0.0", "0.5")
    finally:
        FILES["near"] = original


@pytest.mark.parametrize(
    "unseen", [(i for i in range(3)), [np.zeros(2000)], Path.cwd(), np.array([None]), SimpleNamespace(a=1)]
)
def test_what_nothing_stands_for_is_compiled_in_every_process(unseen):
    @compiled
    def kernel():
        return unseen

    with pytest.raises(Opaque):
        fingerprint(kernel, ())


# ---------------------------------------------------------------- where it is kept
@pytest.fixture(name="cache")
def _cache(tmp_path, monkeypatch):
    monkeypatch.setattr("numba.core.config.CACHE_DIR", str(tmp_path))
    return tmp_path


def doubled(x):
    return 2.0 * x


def test_damaged_code_is_compiled_anew(cache):
    assert compiled(doubled)(1.5) == 3.0
    (file,) = kept_in(cache)
    whole = file.read_bytes()
    for damaged in (b"", whole[:200], whole[:-1], whole[:500] + bytes([whole[500] ^ 1]) + whole[501:]):
        file.write_bytes(damaged)
        again = compiled(doubled)
        assert again(1.5) == 3.0
        assert again.stats.cache_misses.total() == 1
    last = compiled(doubled)
    assert last(1.5) == 3.0
    assert last.stats.cache_hits.total() == 1
    assert pickle.loads(pickle.dumps(last))(2.5) == 5.0
    last._cache.flush()
    assert not kept_in(cache)


def test_a_full_disk_only_means_that_nothing_is_kept(cache, monkeypatch):
    def full(self, data):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    assert compiled(doubled)(1.5) == 3.0
    assert not kept_in(cache)


def test_closures_of_different_values_are_kept_side_by_side(cache):
    def plus(n):
        @compiled
        def kernel(x):
            return x + n

        return kernel

    assert [plus(n)(1.0) for n in (6, 7, 6, 7)] == [7.0, 8.0, 7.0, 8.0]
    assert len(kept_in(cache)) == 2


def bound_by_permissions():
    """Not even root may write where the permissions say no: the process gives up the capability of number 1."""
    header, sets = (ctypes.c_uint32 * 2)(0x20080522, 0), (ctypes.c_uint32 * 6)()
    assert ctypes.CDLL(None).capget(header, sets) == 0
    sets[0] &= ~2
    assert ctypes.CDLL(None).capset(header, sets) == 0


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="root gives up its right to write by a call of Linux")
def test_where_nothing_can_be_written_a_private_folder_keeps_it_with_one_line_of_warning(tmp_path):
    folder, home, temporary = (tmp_path / name for name in ("package", "home", "tmp"))
    for place in (folder, home, temporary):
        place.mkdir()
    write_two(folder)
    env = {"HOME": str(home), "TMPDIR": str(temporary)}
    for place in (folder, home):
        place.chmod(0o555)
    try:
        value, count, warning = finish(start(folder, env, before=bound_by_permissions))
        assert (value, count) == (3.0, 2)
        (line,) = warning.splitlines()
        assert "NUMBA_CACHE_DIR" in line
        (private,) = temporary.iterdir()
        assert stat.S_IMODE(private.stat().st_mode) == 0o700
        assert finish(start(folder, env, before=bound_by_permissions))[:2] == (3.0, 0)
        env["NUMBA_CACHE_DIR"] = str(temporary / "own")
        assert finish(start(folder, env, before=bound_by_permissions)) == (3.0, 2, "")
    finally:
        folder.chmod(0o755)


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="users as POSIX has them")
def test_a_private_folder_is_nobody_elses(tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setattr(optik.compiled.cache, "_warn", lambda what: None)
    found = optik.compiled.cache._private_folder.__wrapped__
    usual = tmp_path / f"optik-{os.getuid()}"
    assert found() == usual == found()
    assert stat.S_IMODE(usual.stat().st_mode) == 0o700
    usual.chmod(0o770)
    other = found()
    assert other != usual
    assert stat.S_IMODE(other.stat().st_mode) == 0o700
    usual.rmdir()
    usual.symlink_to(other)
    assert found() not in (usual, other)
    if os.geteuid() == 0:
        usual.unlink()
        usual.mkdir(mode=0o700)
        os.chown(usual, 65534, 65534)
        assert found() != usual


def test_where_no_folder_at_all_can_be_written_it_is_compiled_all_the_same(monkeypatch):
    monkeypatch.setattr(optik.compiled.cache._Place, "_locator_classes", ())
    optik.compiled.cache._warn.cache_clear()
    kernel = compiled(doubled)
    with pytest.warns(RuntimeWarning, match="NUMBA_CACHE_DIR"):
        assert kernel(1.5) == 3.0
    assert kernel._cache.cache_path is None


def test_division_by_zero_is_infinite_and_nan_stays_nan():
    @compiled
    def divided(x, y):
        return x / y

    assert divided(1.0, 0.0) == np.inf
    assert np.isnan(divided(0.0, 0.0))
    assert np.isnan(divided(np.nan, 1.0) * 0.0)  # no fast-math


# ---------------------------------------------------------------- what is left out of the compilation
@inlined
def tripled(x):
    return 3.0 * x


def test_a_helper_can_be_called_from_python():
    assert tripled(1.5) == 4.5


@pytest.mark.parametrize("package", ["optik", "planners", "benchmarks"])
def test_every_helper_of_ours_is_compiled_into_kernels_only(package):
    """Numba's call of code that has no wrapper would end the process; see the call above."""
    assert Helper.__call__ is not Kernel.__call__
    for file in (REPOSITORY / package).rglob("*.py"):
        if "import compiled, inlined" in file.read_text(encoding="utf-8"):
            module = importlib.import_module(".".join(file.relative_to(REPOSITORY).with_suffix("").parts))
            assert not [k for k in vars(module).values() if is_jitted(k) and not isinstance(k, Kernel)]


def test_an_integer_that_is_known_while_compiling_gets_no_code_of_its_own(cache):
    @compiled
    def power(x, n):
        return x**n

    @compiled
    def powers(x, n):
        return power(x, 2) + power(x, 3) + power(x, n)

    assert powers(2.0, 4) == 28.0
    assert power.signatures == [(types.float64, types.int64)]


@pytest.mark.parametrize("collects", [True, False])
def test_the_collector_is_as_before_even_after_an_error(collects):
    @compiled
    def wrong(x):
        return x.nothing

    level = numba.core.config.OPT
    (gc.enable if collects else gc.disable)()
    try:
        with pytest.raises(numba.core.errors.TypingError):
            wrong(1.0)
        assert compiled(doubled)(1.0) == 2.0
        assert gc.isenabled() == collects
    finally:
        gc.enable()
    assert numba.core.config.OPT is level


@pytest.mark.parametrize("shipped", [True, False])
@pytest.mark.parametrize(("seconds", "quiet", "told"), [(-1.0, "", True), (-1.0, "quiet", False), (1e9, "", False)])
def test_a_log_or_a_notebook_is_told_once_that_functions_are_compiled(tmp_path, seconds, quiet, told, shipped):
    write_two(tmp_path)
    code = (
        f"import optik.compiled.kernel as k; k.QUIET_SECONDS = {seconds}; k.archive.open_archive = lambda: {shipped or ''!r}; "
        "import outer; outer.outer(1.0)"
    )
    env = os.environ | {"PYTHONPATH": os.pathsep.join([str(REPOSITORY), str(tmp_path)]), "OPTIK_COMPILES": quiet}
    done = subprocess.run(
        [sys.executable, "-c", code], env=env, capture_output=True, text=True, check=True, timeout=120
    )
    assert done.stderr.splitlines() == ([NOT_SHIPPED] * (not shipped) + [FIRST_USE]) * told


def test_where_there_is_no_terminal_a_long_compilation_adds_a_line_every_ten_seconds(monkeypatch, capsys):
    clock = iter(np.arange(0.0, 65.0, 4.0))
    monkeypatch.setattr(
        kernel, "_Process", type("Fresh", (kernel._Process,), {"depth": 1, "due": 0.0, "begin": 0.0, "seconds": 0.0})
    )
    monkeypatch.setattr(kernel, "time", SimpleNamespace(monotonic=lambda: next(clock)))
    for _ in range(16):
        kernel._tell("planned")
    lines = capsys.readouterr().err.splitlines()
    assert FIRST_USE in lines and lines[-4:] == [f"optik: compiling, {s} s: planned" for s in (16, 28, 40, 52)]


@pytest.mark.skipif(sys.platform == "win32", reason="terminals as POSIX has them")
def test_a_terminal_is_told_of_a_long_compilation_and_the_line_is_removed(tmp_path):
    import pty

    write_two(tmp_path)
    code = "import optik.compiled.kernel; optik.compiled.kernel.QUIET_SECONDS = {}; import outer; outer.outer(1.0)"
    env = os.environ | {"PYTHONPATH": os.pathsep.join([str(REPOSITORY), str(tmp_path)]), "OPTIK_COMPILES": ""}
    for seconds, told in ((-1.0, True), (1e9, False)):
        for file in kept_in(tmp_path):
            file.unlink()
        ours, theirs = pty.openpty()
        with subprocess.Popen([sys.executable, "-c", code.format(seconds)], env=env, stderr=theirs) as process:
            process.wait(timeout=120)
        os.close(theirs)
        words = os.read(ours, 10_000).decode() if told else ""
        os.close(ours)
        assert ("compiling, 0 s: inner" in words) is told
        assert words.endswith("\x1b[K") is told


def test_a_fingerprint_does_not_depend_on_where_packages_are_installed(monkeypatch):
    from optik import kinematics, load

    chain = load("ur5e").chain
    signature = (typeof(chain), types.Array(types.float64, 2, "C"), types.Array(types.float64, 3, "C"))
    here = fingerprint(kinematics.fk_batch, signature)
    monkeypatch.setattr(np.__spec__, "origin", "/elsewhere/numpy/__init__.py")
    assert "/elsewhere" in repr(np)
    assert fingerprint(kinematics.fk_batch, signature) == here
