"""The structure: what importing costs, how a file in a folder becomes a name, and the errors."""

import ast
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import optik
from optik import errors, registry
from optik.errors import InvalidInput, MissingDependency, OptikError, RobotModelError, UnknownName, Unsupported
from tests.mutants.listed import EQUIVALENT, LISTED
from tests.oracles import REPOSITORY


def run(code, *arguments, path=()):
    """Run a few lines in a fresh interpreter and return what they print."""
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(map(str, (REPOSITORY, *path)))}
    done = subprocess.run(
        [sys.executable, "-c", code, *arguments],
        capture_output=True,
        text=True,
        check=False,
        cwd=REPOSITORY,
        env=environment,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


# ---------------------------------------------------------------- imports
def test_the_import_name_optik_is_ours():
    assert Path(optik.__file__).resolve() == REPOSITORY / "optik" / "__init__.py"
    assert Path(run("import optik; print(optik.__file__)")[0]).resolve() == REPOSITORY / "optik" / "__init__.py"


def loaded(code, *packages):
    """Which of the packages, or modules of them, are loaded after some lines in a fresh interpreter."""
    return run(f"import sys\n{code}\nprint(*(m for m in sys.argv[1:] if m in sys.modules))", *packages)


HEAVY = (
    "casadi", "plotly", "polars", "ruckig", "toppra", "typer", "jinja2", "scipy.interpolate", "scipy.linalg",
    "scipy.ndimage", "scipy.optimize", "scipy.sparse", "scipy.spatial", "scipy.special",
)  # fmt: skip


@pytest.mark.parametrize("package", ["optik", "planners"])
def test_importing_a_package_loads_numpy_and_numba_and_nothing_heavier(package):
    # Numba itself loads the empty top of SciPy, to read its version; none of SciPy's parts may follow.
    assert loaded(f"import {package}", *HEAVY) == []
    assert loaded(f"import {package}", "numpy", "numba") == ["numpy", "numba"]


def test_the_command_line_loads_no_planner_before_a_command_needs_it():
    heavy = {*HEAVY, "planners", "planners.plan", "planners.cell"} - {"typer"}
    assert loaded("import benchmarks.cli.app", *heavy) == []


def test_a_solve_by_dls_loads_no_casadi_and_by_ipopt_does():
    code = "import optik; r = optik.load('paper6r'); q = [0.1] * 6; optik.solve_ik(r, r.fk(q), q, {!r})"
    by_numba = {"scipy.linalg"}  # to find the BLAS, when it first loads a compiled function
    assert set(loaded(code.format("dls"), *HEAVY)) <= by_numba
    assert "casadi" in loaded(code.format("ipopt"), *HEAVY)


# ---------------------------------------------------------------- names
FOLDERS = {"optik.ik": {"dls", "ipopt"}, "optik.robots": {"paper6r", "puma560", "ur5e"}}


@pytest.mark.parametrize(("folder", "expected"), FOLDERS.items(), ids=FOLDERS.keys())
def test_the_files_of_a_folder_are_its_names_sorted(folder, expected):
    names = registry.names(folder)
    assert expected <= set(names)
    assert list(names) == sorted(names)
    files = list((REPOSITORY / folder.replace(".", "/")).iterdir())
    methods = {f.stem for f in files if f.suffix == ".py" and "\nMETHOD = " in f.read_text()}
    assert set(names) == methods | {f.stem for f in files if f.suffix == ".toml"}


def test_listing_names_imports_none_of_them():
    code = "from optik.registry import names\nassert 'ipopt' in names('optik.ik')"
    assert loaded(code, "casadi", "optik.ik.dls", "optik.ik.ipopt") == []


@pytest.mark.parametrize("folder", ["optik.ik"])
def test_every_name_can_be_loaded_and_is_a_method(folder):
    for name in registry.names(folder):
        try:
            method = registry.load_method(folder, name)
        except MissingDependency:
            continue
        assert method.__module__ == f"{folder}.{name}"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """An empty package of methods on the path, of a name that no other test has used."""
    package = tmp_path / f"methods_{abs(hash(tmp_path))}"
    package.mkdir()
    (package / "__init__.py").write_text('"""Methods."""\n')
    monkeypatch.syspath_prepend(tmp_path)
    return package


def test_a_new_file_is_a_new_name_and_its_method_is_what_it_says(folder):
    (folder / "newton.py").write_text("METHOD = 42\n")
    (folder / "base.py").write_text("raise RuntimeError\n")
    (folder / "_common.py").write_text("METHOD = 1\n")
    (folder / "shared.py").write_text("raise RuntimeError  # METHOD = 1\n")
    (folder / "notes.md").write_text("raise RuntimeError\n")
    (folder / "arm.toml").write_text("")
    assert registry.names(folder.name) == ("arm", "newton")
    assert registry.load_method(folder.name, "newton") == 42
    assert registry.data_file(folder.name, "arm", "robot") == folder / "arm.toml"


def test_a_missing_package_is_named_with_who_needs_it(folder):
    (folder / "fancy.py").write_text("import no_such_package_at_all.inner\nMETHOD = 1\n")
    with pytest.raises(MissingDependency) as caught:
        registry.load_method(folder.name, "fancy", "IK method")
    error = caught.value
    assert error.package == "no_such_package_at_all"
    assert error.needed_by == "IK method 'fancy'"
    assert "IK method 'fancy' needs the package no_such_package_at_all" in str(error)
    assert "install" in str(error)
    assert isinstance(error, ImportError)
    assert isinstance(error.__cause__, ModuleNotFoundError)


def test_a_missing_package_of_an_extra_names_the_extra(folder, monkeypatch):
    pytest.importorskip("importlib.metadata").distribution("optik-toolkit")
    (folder / "closed.py").write_text("import ssik.prebuilt\nMETHOD = 1\n")
    for module in [m for m in sys.modules if m.partition(".")[0] == "ssik"]:
        monkeypatch.delitem(sys.modules, module)
    monkeypatch.setitem(sys.modules, "ssik", None)  # what Python itself keeps for a module that must not be found
    with pytest.raises(MissingDependency, match=r"pip install 'optik-toolkit\[closed-form\]'") as caught:
        registry.load_method(folder.name, "closed")
    assert caught.value.package == "ssik"


@pytest.mark.parametrize("part", ["optik", "planners", "benchmarks"])
def test_a_missing_module_of_ours_shows_itself(folder, part):
    (folder / "broken.py").write_text(f"from {part}.no_such_module import something as METHOD\nMETHOD = METHOD\n")
    with pytest.raises(ModuleNotFoundError, match=f"{part}.no_such_module") as caught:
        registry.load_method(folder.name, "broken")
    assert not isinstance(caught.value, OptikError)


def test_a_missing_name_of_ours_and_a_bug_show_themselves(folder):
    (folder / "typo.py").write_text("from optik.arm.robot import Rowbot\nMETHOD = Rowbot\n")
    (folder / "crash.py").write_text("METHOD = 1 / 0\n")
    with pytest.raises(ImportError, match="Rowbot") as caught:
        registry.load_method(folder.name, "typo")
    assert not isinstance(caught.value, OptikError)
    with pytest.raises(ZeroDivisionError):
        registry.load_method(folder.name, "crash")


def test_an_unknown_name_lists_the_nearest(folder):
    for name in ("levenberg", "newton"):
        (folder / f"{name}.py").write_text("METHOD = 1\n")
    for load in (registry.load_method, lambda *a: registry.data_file(*a, "method")):
        with pytest.raises(UnknownName) as caught:
            load(folder.name, "newtown")
        assert caught.value.nearest == ("newton",)
        assert caught.value.known == ("levenberg", "newton")
        assert str(caught.value) == "unknown method 'newtown'; did you mean newton? there are: levenberg, newton"


@pytest.mark.parametrize("name", ["__init__", "base", "_private", "ik.dls", "", "Newton"])
def test_what_is_no_name_is_not_loaded(folder, name):
    for file in ("newton", "base", "_private"):
        (folder / f"{file}.py").write_text("METHOD = 1\n")
    with pytest.raises(UnknownName):
        registry.load_method(folder.name, name)


@pytest.mark.parametrize("name", ["../registry", "newton.py", "./newton"])
def test_a_path_without_a_file_is_said_to_be_a_path(folder, name):
    (folder / "newton.py").write_text("METHOD = 1\n")
    with pytest.raises(InvalidInput, match=r"expected a file, because .* is a path; got '.*', which is no file"):
        registry.load_method(folder.name, name)


def test_a_folder_with_an_init_is_a_name_and_another_is_none(folder):
    for name in ("newton", "notes"):
        (folder / name).mkdir()
    (folder / "newton" / "__init__.py").write_text("METHOD = 7\n")
    assert registry.names(folder.name) == ("newton",)
    assert registry.load_method(folder.name, "newton") == 7


# ---------------------------------------------------------------- errors
ERRORS = [
    InvalidInput("q0", "shape (5,)", "shape (6,)"),
    Unsupported("task", "position", '"pose"'),
    RobotModelError("arm", "no joints"),
    UnknownName("robot", "pume", ("puma560", "ur5e")),
    MissingDependency("ssik", "IK method 'closed'", "dev"),
    errors.InvalidMotion("contact of link3 and box", ("contact",), s=0.1, advice="another path"),
    errors.NoSolution("joint 2 at its limit", s=0.1, joint="joint2", advice="a shorter line"),
    errors.OutputError("run", "contains something else"),
]
BUILT_IN = [ValueError, ValueError, ValueError, LookupError, ImportError, RuntimeError, RuntimeError, OSError]


@pytest.mark.parametrize(("error", "kind"), zip(ERRORS, BUILT_IN, strict=True), ids=lambda e: type(e).__name__)
def test_every_error_is_optiks_and_one_of_pythons_and_crosses_processes_with_its_data(error, kind):
    import copy
    import pickle

    assert isinstance(error, OptikError)
    assert isinstance(error, kind)
    for back in (pickle.loads(pickle.dumps(error)), copy.copy(error)):
        assert type(back) is type(error)
        assert str(back) == str(error)
        assert back.__dict__ == error.__dict__


def test_every_kind_of_error_is_in_the_list_above():
    def kinds(base):
        return {base}.union(*(kinds(k) for k in base.__subclasses__()))

    ours = {k for k in kinds(OptikError) if k.__module__ == "optik.errors"} - {OptikError}
    assert {type(e) for e in ERRORS} == ours


@pytest.mark.parametrize("package", ["optik", "planners"])
def test_no_sentence_of_a_library_names_an_option_of_the_command_line(package):
    found = []
    for file in (REPOSITORY / package).rglob("*.py"):
        tree = ast.parse(file.read_text(encoding="utf-8"))
        skipped = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}  # docstrings
        for node in ast.walk(tree):
            if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in skipped:
                found += [f"{file.name}: {word}" for word in re.findall(r"(?<![\w(-])--[a-z][\w-]*", node.value)]
    assert found == []


def test_every_listed_mutant_matches_the_source_once():
    for file, old, _new in LISTED:
        assert (REPOSITORY / file).read_text().count(old) == 1, (file, old)
    for file, old, _new in EQUIVALENT:
        assert old in (REPOSITORY / file).read_text(), (file, old)
