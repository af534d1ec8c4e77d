"""Plug-ins from outside: files by their paths and entry points of installed packages, in the API, commands and workers."""

import ast
import copy
import hashlib
import importlib.metadata
import json
import os
import pickle
import re
import sys
import tomllib
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numba
import numpy as np
import polars as pl
import pytest
from typer.testing import CliRunner

import optik
import planners
from benchmarks.blocks.base import Trials, load_kind
from benchmarks.cli.app import app
from benchmarks.problems.base import ProblemSet
from benchmarks.report.page import write_report
from benchmarks.run import run_suite
from benchmarks.run.pool import Pool, ThisProcess, attempt
from benchmarks.suite import load_suite
from optik import registry
from optik.errors import AssumptionWarning, InvalidInput, MissingDependency, UnknownName
from optik.plugins import files
from planners.paths import path_of
from tests import conftest, forks
from tests.oracles import REPOSITORY
from tests.outside import EXAMPLES as EXAMPLE_OF
from tests.planners import contacts
from tests.planners.cases import START, default_joint_path, paper6r

EXAMPLES = REPOSITORY / "examples" / "plugins"
ARM = EXAMPLES.parent / "arm.urdf"

IK = '''
from optik.ik.base import Attempt, IKSolver, IKStatus

class Stay(IKSolver):
    """Answers its start."""

    def attempt(self, target, start, trace, time_limit):
        return Attempt(start.copy(), IKStatus.STALLED, 0, None, "{said}")

METHOD = Stay
'''


@pytest.fixture(autouse=True)
def forgotten(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Every test begins as a process does that has loaded no plug-in."""
    monkeypatch.setattr(registry, "_loaded", {})
    monkeypatch.setattr(files, "_expected", {})
    yield


def write(file: Path, text: str = IK, **values: str) -> Path:
    for key, value in values.items():
        text = text.replace("{" + key + "}", value)
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(text)
    return file


def package(folder: Path, name: str, points: str, **modules: str) -> Path:
    """A package as an installer leaves it: modules, and a folder with its name, version and entry points."""
    info = folder / f"{name}-1.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(points)
    for module, text in modules.items():
        (folder / f"{module}.py").write_text(text)
    return folder


# ---------------------------------------------------------------- files: what is one, and what is refused
@pytest.mark.parametrize(
    "name", ["./jt", "jt.py", "a/b", "ARM.URDF", "arm.urdf#tip=tool", "x.toml", "x.json", Path("lm")]
)
def test_a_separator_or_a_suffix_makes_a_path(name: Any) -> None:
    assert files.is_path(name)


@pytest.mark.parametrize("name", ["lm", "jt", "v1.2", "", "arm#tip=tool", None, 3])
def test_a_bare_name_is_never_a_path(name: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert not files.is_path(name)
    write(tmp_path / "jt.py")
    monkeypatch.chdir(tmp_path)
    with pytest.raises((UnknownName, InvalidInput)):
        registry.load_method("optik.ik", "jt")


def test_a_file_is_a_method_that_reports_call_by_its_stem(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = write(tmp_path / "stay_1.py", said="here")
    monkeypatch.chdir(tmp_path)
    solver = optik.ik.make_solver(paper6r(), "./stay_1.py")
    assert (solver.name, registry.short_name("./stay_1.py")) == ("stay_1", "stay_1")
    assert type(optik.ik.make_solver(paper6r(), file)) is type(solver)
    assert optik.solve_ik(paper6r(), paper6r().fk(START), np.zeros(6), "stay_1.py").message == "here"
    kept = optik.ik.get_solver(paper6r(), "./stay_1.py")
    assert optik.ik.get_solver(paper6r(), str(file)).__class__ is kept.__class__
    assert registry.find_loaded("optik.ik", "stay_1") is type(solver)


def test_the_same_relative_path_elsewhere_is_another_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    said = []
    for folder in ("a", "b"):
        write(tmp_path / folder / "stay_2.py", said=folder)
        monkeypatch.chdir(tmp_path / folder)
        monkeypatch.setattr(registry, "_loaded", {})
        said.append(optik.solve_ik(paper6r(), paper6r().fk(START), np.zeros(6), "./stay_2.py").message)
    assert said == ["a", "b"]


def test_a_file_that_was_edited_is_imported_anew_unless_it_fails_or_a_run_is_going_on(tmp_path: Path) -> None:
    file = write(tmp_path / "stay_3.py", said="one")

    def said() -> str:
        return optik.solve_ik(paper6r(), paper6r().fk(START), np.zeros(6), file).message

    assert said() == "one"
    first = registry.label(optik.ik.make_solver(paper6r(), file))
    write(file, said="two")
    assert said() == "two"
    assert first.startswith("stay_3@") and registry.label(optik.ik.make_solver(paper6r(), file)) != first
    whole = file.read_text()
    for broken in (whole + "(", whole + "\n1 / 0\n"):
        file.write_text(broken)
        with pytest.warns(
            AssumptionWarning, match=r"stay_3.py has changed and fails .*; its last version stays in use"
        ):
            assert said() == "two"
    file.write_text(whole)
    with files.expected(files.record_plugins([files.UsedPlugin("optik.ik", "stay_3", file)])):
        write(file, said="three")
        with pytest.raises(InvalidInput, match="SHA-256"):
            said()
    assert said() == "three"


@pytest.mark.parametrize(
    ("name", "group", "kind"),
    [
        ("lm.py", "optik.ik", "IK method"),
        ("optimal.py", "planners.timing", "time law"),
        ("ur5e.py", "optik.robots", "robot"),
    ],
)
def test_a_file_with_the_name_of_one_of_ours_is_refused(tmp_path: Path, name: str, group: str, kind: str) -> None:
    file = write(tmp_path / name)
    for use in (registry.load_method, registry.check_name):
        with pytest.raises(InvalidInput, match=rf"^{kind}: .*{file.stem} as is one of ours, {group}.{file.stem}"):
            use(group, str(file), kind)


def test_two_files_of_one_name_are_refused(tmp_path: Path) -> None:
    first, second = write(tmp_path / "a" / "stay_4.py"), write(tmp_path / "b" / "stay_4.py")
    registry.load_method("optik.ik", first)
    with pytest.raises(InvalidInput, match=r"b/stay_4.py.*another file, .*a/stay_4.py"):
        registry.load_method("optik.ik", second)
    with files.collect_plugins(tmp_path), pytest.raises(InvalidInput, match=r"a/beside.py and .*b/beside.py"):
        for folder in "ab":
            write(tmp_path / folder / "beside.py")
            registry.check_name("benchmarks.problems", f"{folder}/beside.py", "problem set")


BROKEN = {
    "no METHOD": ("x = 1", "a line METHOD = …, a subclass of optik.ik.IKSolver"),
    "a function": ("def METHOD(robot): ...", "a subclass of optik.ik.IKSolver"),
    "another class": ("class METHOD: ...", "a subclass of optik.ik.IKSolver"),
    "abstract": ("from optik.ik import IKSolver\nclass METHOD(IKSolver): ...", "METHOD without attempt"),
    "another name": (IK.replace("def attempt", "name = 'other'\n    def attempt"), "the name 'other'"),
    "an object": (IK.replace("METHOD = Stay", "METHOD = Stay.__new__(Stay)"), "METHOD = Stay"),
    "one of ours": ("from optik.ik.dls import DLS as METHOD", "the name 'dls'"),
}


@pytest.mark.parametrize("case", BROKEN)
def test_what_is_no_method_is_refused_by_what_it_must_be(tmp_path: Path, case: str) -> None:
    text, words = BROKEN[case]
    file = write(tmp_path / "broken.py", text)
    with pytest.raises(InvalidInput) as caught:
        registry.load_method("optik.ik", file)
    assert words in str(caught.value)
    assert str(file) in str(caught.value)


def test_what_must_be_declared_is_named(tmp_path: Path) -> None:
    text = "from planners.timing import TimeLaw\nclass METHOD(TimeLaw):\n    def _time(self, joint_path, limits): ...\n"
    with pytest.raises(
        InvalidInput, match=r"a subclass of planners\.timing\.TimeLaw that defines them; got METHOD without enforced"
    ):
        planners.make_law(write(tmp_path / "undeclared.py", text))


def test_a_file_whose_suffix_was_forgotten_is_offered(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write(tmp_path / "slow.py")
    write(tmp_path / "slow_arm.toml")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UnknownName, match=r"there are: .*; for a file write \./slow\.py$"):
        optik.ik.make_solver(paper6r(), "slow")
    with pytest.raises(UnknownName, match=r"for a file write \./slow_arm\.toml$"):
        optik.load("slow_arm")
    with pytest.raises(UnknownName, match=r"there are: [^;]*$"):
        optik.ik.make_solver(paper6r(), "slow_arm")
    with pytest.raises(InvalidInput, match=r"expected \./slow\.py, which is one; got '\./slow', which is no file"):
        optik.ik.make_solver(paper6r(), "./slow")
    monkeypatch.chdir(tmp_path.parent)
    with files.collect_plugins(tmp_path), pytest.raises(UnknownName, match=r"\./slow\.py$"):
        registry.check_name("optik.ik", "slow", "IK method")


@pytest.mark.parametrize(
    ("option", "words"),
    [
        (
            "planners.timings=./law.py",
            "no group 'planners.timings'; there are: optik.ik, optik.robots, planners.timing",
        ),
        ("planners.timing=./none.py", "no such file: ./none.py"),
        ("./law.py", "expected GROUP=PATH"),
    ],
)
def test_a_wrong_plug_in_for_the_contract_tests_is_a_usage_error(option: str, words: str) -> None:
    class Config:
        def getoption(self, name: str) -> list[str]:
            return [option]

    config: Any = Config()
    with pytest.raises(pytest.UsageError) as caught:
        conftest.pytest_configure(config)
    assert words in str(caught.value)


def test_errors_in_a_file_show_themselves_and_a_missing_package_is_named(tmp_path: Path) -> None:
    with pytest.raises(ZeroDivisionError) as caught:
        registry.load_method("optik.ik", write(tmp_path / "divides.py", "\n1 / 0\n"))
    assert Path(caught.traceback[-1].path).name == "divides.py"
    assert caught.traceback[-1].lineno == 1
    with pytest.raises(MissingDependency, match=r"IK method 'needs' needs the package no_such_package"):
        registry.load_method("optik.ik", write(tmp_path / "needs.py", "import no_such_package.inner"), "IK method")
    with pytest.raises(ModuleNotFoundError, match=r"optik\.no_such"):
        registry.load_method("optik.ik", write(tmp_path / "typo.py", "import optik.no_such"))


# ---------------------------------------------------------------- processes, kernels
def test_a_solver_from_a_file_answers_the_same_in_another_process_that_knows_nothing_of_it(tmp_path: Path) -> None:
    solver = optik.ik.make_solver(paper6r(), write(tmp_path / "stay_5.py", said="there"))
    data = pickle.dumps(solver)
    code = (
        "import pickle, sys; solver = pickle.load(sys.stdin.buffer)\n"
        "print(type(solver).name, solver.solve(solver.robot.fk([0.1] * 6), [0.0] * 6).message)"
    )
    done = forks.start(code, data=data, cwd=tmp_path)()
    assert done.stdout.split() == [b"stay_5", b"there"], done.stderr.decode()


def test_an_object_brings_the_path_of_its_file_but_no_right_to_run_it(tmp_path: Path) -> None:
    file = write(tmp_path / "stay_8.py", said="here")
    solver = optik.ik.make_solver(paper6r(), file)
    assert copy.deepcopy(solver).solve(paper6r().fk(START), START).message == "here"
    data = pickle.dumps(solver)
    del sys.modules[type(solver).__module__]
    with files.forbid_code(), pytest.raises(InvalidInput, match="runs no code"):
        pickle.loads(data)
    assert type(pickle.loads(data)) is not type(solver)
    file.unlink()
    with pytest.raises(InvalidInput, match=r"stay_8\.py"):
        pickle.loads(data)


def test_two_files_of_one_stem_are_two_modules(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    solvers = []
    for folder in ("a", "a.b", "a b"):
        monkeypatch.setattr(registry, "_loaded", {})
        solvers.append(optik.ik.make_solver(paper6r(), write(tmp_path / folder / "stay_9.py", said=folder)))
    assert len({type(solver).__module__ for solver in solvers}) == 3
    for solver, folder in zip(solvers, ("a", "a.b", "a b"), strict=True):
        again = pickle.loads(pickle.dumps(solver))
        assert type(again) is type(solver)
        assert again.solve(paper6r().fk(START), START).message == folder


NEIGHBOUR = IK.replace('"{said}"', "said").replace("class Stay", "from .words import said\n\nclass Stay")
"""A method that says what the file ``words.py`` beside it says."""


def test_a_file_imports_its_neighbours_and_they_are_part_of_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made = []
    for folder in ("one", "two"):
        words = write(tmp_path / folder / "words.py", "from . import deep\nfrom .deep import said\n")
        write(words.with_name("deep.py"), f"said = {folder!r}\n")
        monkeypatch.setattr(registry, "_loaded", {})
        made.append(optik.ik.make_solver(paper6r(), write(words.with_name("says.py"), NEIGHBOUR)))
    assert [solver.solve(paper6r().fk(START), START).message for solver in made] == ["one", "two"]
    file, deep = tmp_path / "two" / "says.py", tmp_path / "two" / "deep.py"
    code = "import pickle, sys; s = pickle.load(sys.stdin.buffer); print(s.solve(s.robot.fk([0.1] * 6), [0.0] * 6).message)"
    there = forks.start(code, data=pickle.dumps(made[1]), cwd=tmp_path)()
    assert there.stdout.split() == [b"two"], there.stderr.decode()
    (recorded,) = files.record_plugins([files.UsedPlugin("optik.ik", "says", file)])
    sums = "".join(
        f"{hashlib.sha256(one.read_bytes()).hexdigest()}  {one.name}\n"
        for one in (file, file.with_name("words.py"), deep)
    )
    assert recorded["sha256"] == hashlib.sha256(sums.encode()).hexdigest()
    files.expect([recorded])
    write(deep, "said = 'something else'\n")
    with pytest.raises(InvalidInput, match="SHA-256"):
        registry.load_method("optik.ik", file)
    with pytest.raises(InvalidInput, match="SHA-256"):
        files.expect([recorded])
    with pytest.raises(InvalidInput, match="as when the run began"):
        files.check_same_plugins([recorded], files.record_plugins([files.UsedPlugin("optik.ik", "says", file)]))


def test_a_neighbour_that_is_missing_is_no_missing_package(tmp_path: Path) -> None:
    file = write(tmp_path / "says_nothing.py", NEIGHBOUR)
    with pytest.raises(ModuleNotFoundError, match="words"):
        registry.load_method("optik.ik", file)
    write(tmp_path / "words.py", "said = 'now'\n")
    assert optik.ik.make_solver(paper6r(), file).solve(paper6r().fk(START), START).message == "now"


def test_a_worker_checks_the_files_once_a_part(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = write(tmp_path / "stay_10.py", said="a")
    recorded = files.record_plugins([files.UsedPlugin("optik.ik", "stay_10", file)])
    read, taken = [], files.digest
    monkeypatch.setattr(files, "digest", lambda one: read.append(one) or taken(one))
    for part in range(2):
        assert isinstance(attempt(recorded, pl.DataFrame, {"problem": [part]}), pl.DataFrame)
        assert read == [file] * (part + 1)
    write(file, said="b")
    refused = attempt(recorded, pl.DataFrame, {"problem": [2]})
    assert isinstance(refused, InvalidInput)
    assert refused.argument == str(file)


def test_the_first_process_and_executors_check_the_files_as_workers_do(tmp_path: Path) -> None:
    file = write(tmp_path / "stay_11.py", said="a")
    recorded = files.record_plugins([files.UsedPlugin("optik.ik", "stay_11", file)])
    with ThreadPoolExecutor(1) as executor:
        pools = ThisProcess(recorded), Pool(executor, 1, recorded)
        assert [pool.run_apart(abs, -1) for pool in pools] == [1, 1]
        write(file, said="b")
        for pool in pools:
            with pytest.raises(InvalidInput) as caught:
                pool.run_apart(abs, -1)
            assert caught.value.argument == str(file)


KERNEL = """
from optik.compiled import compiled

@compiled
def METHOD(x):
    {doc}
    return {factor} * x

@compiled
def other(x):
    return x + 1.0
"""


def test_a_compiled_function_of_a_file_is_kept_beside_it_and_compiled_alone_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(numba.config, "CACHE_DIR", "")
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    file = write(tmp_path / "doubles.py", KERNEL, doc='"""Doubles."""', factor="2.0")
    assert registry.load_method("benchmarks.problems", file)(1.5) == 3.0
    assert files.import_file(file).other(1.5) == 2.5
    code = (
        "import sys; from pathlib import Path; from optik.plugins.files import import_file\n"
        "module = import_file(Path(sys.argv[1])); print(module.METHOD(1.5), module.other(1.5))\n"
        "print(*(kernel.stats.cache_hits.total() for kernel in (module.METHOD, module.other)))"
    )
    for doc, factor, said in (('"""Doubles a number."""', "2.0", "3.0 2.5 1 1"), ("", "4.0", "6.0 2.5 0 1")):
        write(file, KERNEL, doc=doc, factor=factor)
        done = forks.start(code, str(file))()
        assert done.stdout.split() == said.split(), done.stderr
    assert len(list((tmp_path / "__pycache__").glob("doubles.*.nbk"))) == 2


# ---------------------------------------------------------------- entry points
@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    site = tmp_path / "site"
    points = "[optik.ik]\nstay_put = stays:METHOD\nlm = stays:METHOD\nboth = stays:METHOD\na/b = stays:METHOD\n"
    package(
        site,
        "stays",
        points,
        stays=IK.replace("{said}", "installed").replace("def att", "name = 'stay_put'\n    def att"),
    )
    package(site, "others", "[optik.ik]\nboth = stays:METHOD\nabsent = stays:nothing\n[optik.robots]\nmade = arms:make\n",
            arms="import optik\ndef make():\n    return optik.load('ur5e')\n")  # fmt: skip
    monkeypatch.syspath_prepend(site)
    for module in ("stays", "arms"):
        sys.modules.pop(module, None)
    return site


def test_an_entry_point_is_a_name_and_listing_imports_nothing(installed: Path) -> None:
    assert "stays" not in sys.modules
    assert "stay_put" in optik.ik.solvers()
    assert "made" in optik.robots()
    assert "lm" in optik.ik.solvers()
    assert not {"both", "a/b"} & set(optik.ik.solvers())
    assert registry.check_name("optik.ik", "stay_put", "IK method") == "stay_put"
    assert "stays" not in sys.modules
    solver = optik.ik.make_solver(paper6r(), "stay_put")
    assert (solver.name, solver.solve(paper6r().fk(START), np.zeros(6)).message) == ("stay_put", "installed")
    assert optik.load("made") == optik.load("ur5e")


def test_ours_stay_what_they_are_and_a_name_of_two_packages_is_refused(installed: Path) -> None:
    assert optik.ik.make_solver(paper6r(), "lm").__class__ is optik.ik.LM
    with pytest.raises(InvalidInput, match=r"'both' of (stays 1.0 and others 1.0|others 1.0 and stays 1.0)"):
        optik.ik.make_solver(paper6r(), "both")
    with pytest.raises(InvalidInput, match="no nothing in it"):
        optik.ik.make_solver(paper6r(), "absent")
    with pytest.raises(InvalidInput, match=r"stay_put as is an entry point of stays 1.0"):
        optik.ik.make_solver(paper6r(), write(installed.parent / "stay_put.py"))
    refused = {(r.name, r.distribution) for r in registry.find_refused("optik.ik")}
    assert refused == {("lm", "stays 1.0"), ("both", "stays 1.0"), ("both", "others 1.0"), ("a/b", "stays 1.0")}


LIMIT = """
from planners.limits import Limit

class Heat(Limit):
    name, units, order = "heat", ("W", "W"), 2

    def judge(self, motion, limit): ...
    def rows(self, path, limit): ...
    def piece_ratios(self, motion, limit, pieces): ...
"""


def test_a_limit_of_an_installed_package_is_known_by_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    points = "[planners.limits]\nheat = heats:Heat\nno_limit = heats:LIMITS\n"
    monkeypatch.syspath_prepend(package(tmp_path, "heats", points, heats=LIMIT + "LIMITS = dict\n"))
    assert "planners.limits" in registry.GROUPS
    limits = planners.MotionLimits(2.0, 10.0, 100.0, extra={"heat": 3.0})
    assert planners.MotionLimits.from_plain(limits.to_plain(), 6).extra == limits.extra
    with pytest.raises(InvalidInput, match=r"a subclass of planners\.limits\.Limit"):
        planners.MotionLimits(2.0, 10.0, 100.0, extra={"no_limit": 3.0})


def test_a_warm_solve_looks_at_no_installed_package(monkeypatch: pytest.MonkeyPatch) -> None:
    target = paper6r().fk(START)
    optik.solve_ik(paper6r(), target, START)

    def asked(**_: Any) -> None:
        raise AssertionError("installed packages were asked")

    monkeypatch.setattr(importlib.metadata, "entry_points", asked)
    monkeypatch.setattr(sys, "path", [*sys.path, "elsewhere"])
    assert optik.solve_ik(paper6r(), target, START)
    assert planners.make_law("quintic").name == "quintic"
    assert optik.load("ur5e").n == 6


def test_the_command_line_lists_what_is_installed_and_what_is_refused(installed: Path) -> None:
    done = forks.command("doctor", "--json", PYTHONPATH=str(installed))
    rows = {(r["name"], r["distribution"]): r["refused"] for r in json.loads(done.stdout)["plugins"]}
    assert done.returncode == 1
    assert rows["stay_put", "stays 1.0"] == ""
    assert "one of ours" in rows["lm", "stays 1.0"]
    assert "2 packages" in rows["both", "others 1.0"]


# ---------------------------------------------------------------- robots
def test_the_example_arm_is_the_same_in_all_its_files(tmp_path: Path) -> None:
    arm = optik.load(EXAMPLES / "arm.toml")
    saved = write(tmp_path / "arm.json", json.dumps(arm.to_dict()))
    code = write(tmp_path / "arm_2.py", f"import optik\ndef METHOD():\n    return optik.load({str(saved)!r})\n")
    q = arm.limits.lower + 0.3 * (arm.limits.upper - arm.limits.lower)
    assert arm.name == "arm"
    assert optik.load(saved) == optik.load(str(code)) == arm
    assert "ur5e" in optik.robots()
    for name in (ARM, f"{ARM}#tip=tool&base=base"):
        np.testing.assert_allclose(optik.load(name).fk(q), arm.fk(q), atol=1e-12)
    inner = optik.load(ARM, tip="link3")
    assert inner.n == 3
    assert optik.load(f"{ARM}#tip=link3") == inner


@pytest.mark.parametrize(
    ("name", "links", "words"),
    [
        ("ur5e", {"tip": "tool"}, "tip: expected none: 'ur5e' is no URDF"),
        ("{examples}/arm.toml", {"base": "base"}, "base: expected none"),
        ("{arm}#end=tool", {}, "options of a URDF"),
        ("{arm}", {"tip": "no_link"}, "no_link"),
        ("{examples}/jt.py", {}, "a Robot, a function that returns one"),
        ("{examples}/arm.step", {}, "no file"),
    ],
)
def test_a_file_that_is_no_robot_is_refused(name: str, links: dict[str, str], words: str) -> None:
    with pytest.raises((InvalidInput, optik.errors.RobotModelError), match=words):
        optik.load(name.format(examples=EXAMPLES, arm=ARM), **links)


ARMS = """
from pathlib import Path
ARM = Path(__file__).parent / "myarm.toml"
OTHER = str(ARM)
SUITE = Path(__file__).parent / "in_the_package.toml"
def broken():
    return 1 / 0
"""
SUITE = '[[budgets]]\nid = "a"\nrobot = "ur5e"\nset = "near_start"\nmethods = [{ solver = "lm" }]\nbudgets = [1]\n'


@pytest.fixture
def myarms(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A package whose entry points name files, one of them called as the entry point is."""
    points = (
        "[optik.robots]\nmyarm = myarms:ARM\nother_arm = myarms:OTHER\nbroken_arm = myarms:broken\n"
        "[benchmarks.suites]\nmysuite = myarms:SUITE\nbroken_suite = myarms:nothing\n"
    )
    site = package(tmp_path / "arms", "myarms", points, myarms=ARMS)
    write(site / "myarm.toml", (EXAMPLES / "arm.toml").read_text())
    write(site / "in_the_package.toml", SUITE)
    monkeypatch.delitem(sys.modules, "myarms", raising=False)
    monkeypatch.syspath_prepend(site)
    for module in ("stays", "arms"):
        sys.modules.pop(module, None)
    return site


def test_what_an_entry_point_gives_has_its_name_whatever_its_file_is_called(myarms: Path) -> None:
    q = [0.1] * 6
    np.testing.assert_array_equal(optik.load("myarm").fk(q), optik.load(EXAMPLES / "arm.toml").fk(q))
    assert (optik.load("myarm").name, optik.load("other_arm").name) == ("myarm", "other_arm")
    assert load_suite("mysuite").name == "mysuite"
    with pytest.raises(InvalidInput, match="called myarm as is an entry point of myarms"):
        optik.load(myarms / "myarm.toml")


def test_a_broken_robot_or_suite_of_a_package_is_listed_with_its_error_beside_the_others(myarms: Path) -> None:
    for arguments, broken, error in (
        (["robots"], "broken_arm", "division by zero"),
        (["bench", "list"], "broken_suite", "no nothing in it"),
    ):
        done = invoked(*arguments, "--json")
        rows = {row["name"]: row for row in json.loads(done.stdout)}
        assert done.exit_code == 0
        assert error in rows[broken]["error"]
        assert sum("error" in row for row in rows.values()) == 1
        assert {"ur5e", "myarm"} <= set(rows) or {"paper", "mysuite"} <= set(rows)
        assert "error:" in invoked(*arguments).stdout


@pytest.mark.parametrize(
    ("name", "short"),
    [
        ("a/two.urdf", "two"),
        ("a/two.urdf#tip=a", "two (tip a)"),
        ("two.urdf#tip=a&base=b", "two (tip a, base b)"),
        (Path("jt.py"), "jt"),
        ("lm", "lm"),
        ("vendor/ur5e.urdf#tip=a", "ur5e.urdf (tip a)"),
        ("vendor/ur5e.toml", "ur5e.toml"),
    ],
)
def test_reports_tell_two_arms_of_one_urdf_apart(name: Any, short: str) -> None:
    assert registry.short_name(name) == short


# ---------------------------------------------------------------- paths, laws, formats, problem sets, peers
def test_a_motion_of_plug_ins_is_saved_loaded_and_certified_but_reading_it_runs_no_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    arm, spiral, tsv = paper6r(), EXAMPLES / "spiral.py", EXAMPLES / "tsv.py"
    data = {"start": arm.fk(START).tolist(), "radius": 0.02, "turns": 1.0, "rise": 0.02}
    path = planners.paths.make_path(spiral, arm, **data)
    limits = planners.MotionLimits(2.0, 10.0, 100.0)
    plan = planners.plan(arm, path, START, solver=EXAMPLES / "jt.py", timing=EXAMPLES / "law.py", limits=limits)
    assert plan, plan.failure
    digits = [hashlib.sha256((EXAMPLES / name).read_bytes()).hexdigest()[:6] for name in ("jt.py", "law.py")]
    assert (plan.solver, plan.law) == (f"jt@{digits[0]}", f"law@{digits[1]}")
    file = tmp_path / "spiral.tsv"
    plan.save(file, format=tsv)
    again = planners.load_motion(file, format=tsv)
    assert again.path.to_dict() == path.to_dict()
    proof = again.certify()  # a file has no positions of the law: they are searched
    assert proof.is_valid == plan.certificate.is_valid
    assert proof.path_error.distance == pytest.approx(plan.certificate.path_error.distance, rel=0.05, abs=2e-9)
    plan.save(tmp_path / "spiral.json")
    monkeypatch.setattr(registry, "_loaded", {})
    for named in ("spiral", str(spiral)):
        with pytest.raises(UnknownName, match="unknown path"):
            path_of(path.to_dict() | {"path": named}, arm)
    with pytest.raises(InvalidInput, match="radius_m"):
        planners.paths.make_path(spiral, arm, **data, radius_m=1.0)


def test_the_law_of_the_example_passes_the_middle_slowly() -> None:
    path, limits = default_joint_path(), planners.MotionLimits(2.0, 10.0, 100.0)
    slow, even = (
        planners.make_law(EXAMPLES / "law.py", slowness=x).run(path, limits).stretched(1.0) for x in (8.0, 0.0)
    )
    middle = 0.5 * (path.robot.limits.lower + path.robot.limits.upper)
    half = 0.5 * (path.robot.limits.upper - path.robot.limits.lower)

    def speeds(motion: planners.Trajectory) -> tuple[float, float]:
        """Share of its duration that a motion spends on the half of the path whose joints are nearer to the middle."""
        t = np.linspace(0.0, motion.duration, 2001)
        nearness = np.mean(1.0 - ((motion(t) - middle) / half) ** 2, axis=1)
        between = np.mean(1.0 - ((path(np.linspace(0.0, path.end, 2001)) - middle) / half) ** 2, axis=1)
        return float(np.mean(nearness > np.median(between))), motion.duration

    assert speeds(slow)[0] > speeds(even)[0]


def test_the_example_peers_and_problems_keep_their_contracts() -> None:
    arm = optik.load(EXAMPLES / "arm.toml")
    draw = registry.load_method("benchmarks.problems", EXAMPLES / "beside.py", "problem set")
    problems, again = draw(arm, 3, count=5), draw(arm, 3, count=5)
    assert isinstance(problems, ProblemSet)
    np.testing.assert_array_equal(problems.targets, again.targets)
    assert problems.frame(arm).height == 5
    way = problems.targets[:, :3, 3] - arm.fk(problems.starts)[:, :3, 3]
    np.testing.assert_allclose(np.linalg.norm(way, axis=1), 0.1)
    peer: Any = registry.load_method("benchmarks.peers.ik", EXAMPLES / "scipy_least_squares.py").build(paper6r())
    found = peer.read(peer.call(paper6r().fk(START), START + 0.1)).q
    np.testing.assert_allclose(paper6r().fk(found[0]), paper6r().fk(START), atol=1e-6)
    limits = planners.MotionLimits(2.0, 10.0, 100.0)
    law: Any = registry.load_method("benchmarks.peers.laws", EXAMPLES / "scipy_spline.py").build(limits.arrays(6))
    motion = law.read(default_joint_path(), law.call(default_joint_path()))
    worst = [float((motion.extrema(order).worst / bound).max()) for order, bound in ((1, 2.0), (2, 10.0))]
    assert max(worst) <= 1.0
    assert max(worst) > 0.99


def invoked(*arguments: str) -> Any:
    """A command in this process, which starts faster, from the folder of the examples."""
    before = Path.cwd()
    os.chdir(EXAMPLES)
    try:
        return CliRunner().invoke(app, list(arguments))
    finally:
        os.chdir(before)


def test_the_command_line_takes_files_wherever_it_takes_names(tmp_path: Path) -> None:
    done = invoked(
        "plan", "path", "spiral.py", "--set", "radius=0.02", "--set", "turns=0.5", "--set", "rise=0.01",
        "--solver", "jt.py", "--timing", "law.py", "--velocity", "2", "--acceleration", "10", "--jerk", "100",
        "--out", str(tmp_path / "x.tsv"), "--format", "tsv.py",
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    assert re.search(r"jt@[0-9a-f]{6} \+ law@[0-9a-f]{6}", done.stdout)
    assert (tmp_path / "x.tsv").read_text().startswith("format\t")
    done = invoked("ik", "-r", "../arm.urdf", "--tip", "link6", "--xyz", "0.3,0.2,0.4", "--solver", "./jt.py", "--json")
    assert json.loads(done.stdout)["solver"] == "jt"
    q = json.loads(done.stdout)["q_deg"]
    done = invoked("fk", ",".join(map(str, q)), "-r", "./arm.toml", "--json")
    assert json.loads(done.stdout)["robot"] == "arm"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["ik", "--xyz", "0,0,1", "--solver", "./none.py"], "'./none.py', which is no file"),
        (["plan", "path", "./spiral.py", "--set", "radius"], "KEY=VALUE"),
        (["plan", "path", "./spiral.py", "--set", "radius=0.1"], "turns"),
        (["plan", "line", "--format", "./tsv.py"], "--out FILE"),
        (["plan", "line", "--robot", "./arm.toml", "--tip", "tool"], "no URDF"),
    ],
)
def test_misuse_is_one_line(arguments: list[str], words: str) -> None:
    result = invoked(*arguments)
    assert isinstance(result.exception, optik.errors.OptikError), result.output
    assert words in str(result.exception)


# ---------------------------------------------------------------- suites: what may run, and what is recorded
def test_a_suite_s_plug_ins_are_noted_without_running_them_and_start_at_its_folder(tmp_path: Path) -> None:
    bomb = write(tmp_path / "methods" / "bomb.py", "raise SystemExit('run')")
    with files.collect_plugins(tmp_path) as found:
        assert registry.check_name("optik.ik", "./methods/bomb.py", "IK method") == str(bomb)
        assert registry.check_name("optik.ik", "lm", "IK method") == "lm"
        assert registry.check_name("optik.ik", "methods/bomb.py", "IK method") == str(bomb)
        with pytest.raises(InvalidInput, match="no file"):
            registry.check_name("optik.ik", "./bomb.py", "IK method")
    assert found == [("optik.ik", "bomb", bomb)]
    with pytest.raises(InvalidInput, match=r"allow_plugins=True.*methods/bomb.py"):
        files.check_allowed(found, False)
    files.check_allowed(found, True)
    files.check_allowed([], False)


def test_the_settings_of_a_finished_run_are_read_where_its_files_are_gone() -> None:
    with files.collect_plugins(None) as found:
        assert registry.check_name("optik.ik", "./gone.py", "IK method") == "./gone.py"
    assert found == []


def test_what_a_run_records_refuses_other_files_and_versions(installed: Path, tmp_path: Path) -> None:
    file = write(tmp_path / "stay_6.py", said="a")
    with files.collect_plugins(tmp_path) as found:
        registry.check_name("optik.ik", "./stay_6.py", "IK method")
        registry.check_name("optik.ik", "stay_put", "IK method")
    first = files.record_plugins(found)
    assert [(row["name"], sorted(row)) for row in first] == [
        ("stay_6", ["group", "name", "path", "sha256"]), ("stay_put", ["distribution", "group", "name", "version"])
    ]  # fmt: skip
    first.reverse()
    files.check_same_plugins(first, files.record_plugins(found))
    files.check_same_plugins(first, [first[0], first[1] | {"path": "elsewhere"}])
    write(file, said="b")
    for now in (
        files.record_plugins(found),
        first[:1],
        [first[0] | {"version": "2.0"}, first[1]],
        [*first, first[1] | {"name": "x"}],
    ):
        with pytest.raises(
            InvalidInput, match=r"^plug-in .*as when the run began; restore it, or begin a run in another folder"
        ):
            files.check_same_plugins(first, now)
    with pytest.raises(InvalidInput, match="SHA-256"):
        files.expect(first)
    with pytest.raises(InvalidInput, match="SHA-256"):
        registry.load_method("optik.ik", file)


def test_where_no_code_may_run_none_does(tmp_path: Path) -> None:
    file = write(tmp_path / "stay_7.py")
    with files.forbid_code(), pytest.raises(InvalidInput, match="runs no code"):
        registry.load_method("optik.ik", file)
    kind = registry.load_method("optik.ik", file)
    with files.forbid_code():
        assert registry.load_method("optik.ik", file) is kind


# ---------------------------------------------------------------- examples
def test_every_kind_of_plug_in_has_an_example_that_the_map_names() -> None:
    missing = sorted({*registry.GROUPS} - {*EXAMPLE_OF, "benchmarks.blocks"})
    assert not missing, f"no example for {', '.join(missing)}: add one to examples/plugins/ and to tests/outside.py"
    pages = {
        name: (REPOSITORY / "docs" / name).read_text(encoding="utf-8") for name in ("architecture.md", "extending.md")
    }
    for name in EXAMPLE_OF.values():
        assert (EXAMPLES / name).is_file()
        assert [page for page, text in pages.items() if f"examples/plugins/{name}" not in text] == [], name


def test_the_freedom_of_the_example_is_used_within_its_range() -> None:
    arm, standoff = paper6r(), {str(EXAMPLES / "standoff.py"): (-0.02, 0.01)}
    start = arm.fk(START)
    line = planners.Line(start, start @ optik.se3.pose(np.eye(3), [0.1, 0.05, 0.0]))
    limits = planners.MotionLimits(2.0, 10.0, 100.0)
    plan = planners.plan(arm, planners.free(line, **standoff), START, limits=limits)
    assert plan and plan.freedom is not None and plan.freedom.gain > 0.0
    (found,) = plan.freedom.ranges
    assert (found.name, found.unit, found.allowed) == ("standoff", "m", (-0.02, 0.01))
    seen = np.linalg.inv(start) @ arm.fk(
        plan.trajectory(np.linspace(0.0, plan.trajectory.end, 200))
    )  # in the tool's frame
    np.testing.assert_allclose(seen[:, :3, :3], np.broadcast_to(np.eye(3), (200, 3, 3)), atol=1e-5)
    np.testing.assert_allclose(seen[:, 0, 3], 2.0 * seen[:, 1, 3], atol=1e-5)
    assert np.ptp(seen[:, 2, 3]) > 0.005 and seen[:, 2, 3].min() > -0.02001 and seen[:, 2, 3].max() < 0.01001


def test_the_search_of_the_example_finds_the_same_proved_path_again() -> None:
    arm, rest, turn = optik.load("panda"), contacts.REST, np.array([0.9, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    scene = optik.Scene(boxes=[(contacts.pose((0.5, 0.0, 0.45)), (0.5, 0.02, 0.7))], margin=0.005)
    first, again = (
        planners.find_path(arm, rest - turn, rest + turn, scene=scene, search=EXAMPLES / "prm.py", paths=1)
        for _ in range(2)
    )
    assert first and len(first.vertices) > 2
    np.testing.assert_array_equal(first.vertices, again.vertices)
    closed = optik.Scene(boxes=[(contacts.pose((0.0, 0.0, 0.45)), (3.0, 0.02, 3.0))])
    assert not planners.find_path(
        arm, rest - turn, rest + turn, scene=closed, search=EXAMPLES / "prm.py", max_samples=50
    )


def test_every_example_says_what_it_is_and_how_to_try_it() -> None:
    found = [file for file in sorted(EXAMPLES.glob("*.py")) if "METHOD" in file.read_text(encoding="utf-8")]
    assert {file.name for file in found} == {name for name in EXAMPLE_OF.values() if name.endswith(".py")}
    for file in found:
        docstring = ast.get_docstring(ast.parse(file.read_text()))
        assert docstring and "in one file" in docstring.splitlines()[0]


def test_the_package_of_the_examples_works_as_installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    project = tomllib.loads((EXAMPLES / "package" / "pyproject.toml").read_text())["project"]
    points = "\n".join(
        f"[{group}]\n" + "\n".join(f"{name} = {value}" for name, value in named.items())
        for group, named in project["entry-points"].items()
    )
    site = package(tmp_path, "fast_arms", points)
    for place in (EXAMPLES / "package", site):
        monkeypatch.syspath_prepend(place)
    arm = optik.load("pointer")
    target, options = arm.fk([0.1] * 3), {"tolerance": optik.Tolerance(1e-3, 1e-3), "max_iterations": 2000}
    assert optik.solve_ik(arm, target, [0.2] * 3, "random_search", **options)
    assert registry.data_file("benchmarks.suites", "fast_arms", "suite").name == "fast_arms.toml"
    suite = load_suite("fast_arms")
    assert ("benchmarks.blocks", "reach") in {plugin[:2] for plugin in suite.plugins}
    run = run_suite(suite, tmp_path / "run")
    rows = run.rows("reach", "station")
    assert rows.columns == ["block", "method", "problem", "reached", "ms"] and len(rows) == 400
    lm, dls = (rows.filter(method=name)["reached"].sum() for name in ("lm", "dls"))
    assert 200 >= lm > dls > 100
    page = write_report(run).read_text(encoding="utf-8")
    assert '<section id="reach">' in page and "of the box reached" in page
    methods = [{"solver": "lm"}, {"solver": "dls", "max_problems": 1}]
    few = load_kind("reach").settings(suite.settings["reach"][0] | {"count": 2, "methods": methods})
    trials = Trials(load_kind("reach"), few, 0, (0, 1), few.labels)
    for rows in (trials.solve(), trials.crashed()):
        assert rows.select("method", "problem").rows() == [("lm", 0), ("lm", 1), ("dls", 0)]
