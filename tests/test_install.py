"""What this distribution needs on each platform, and what works without the packages that have wheels on some only."""

import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement

PLATFORMS = {
    "Linux x86_64": ("linux", "x86_64", set()),
    "Linux aarch64": ("linux", "aarch64", {"ruckig", "toppra"}),
    "macOS arm64": ("darwin", "arm64", {"toppra"}),
    "Windows": ("win32", "AMD64", {"toppra"}),
}
"""For each platform `sys_platform`, `platform_machine`, and the packages without wheels there."""

WITHOUT = """
import sys
sys.modules["ruckig"] = sys.modules["toppra"] = None
import optik
from planners import Line, MotionLimits, plan, replan
robot = optik.load("ur5e")
q = [0.3, -1.2, 1.4, -0.6, 0.9, 0.2]
goal = robot.fk(q)
goal[:3, 3] += [0.1, 0.05, 0.05]
path = Line(robot.fk(q), goal)
for law in ("optimal", "smooth", "constant_speed"):
    made = plan(robot, path, q, limits=MotionLimits(2.0, 10.0, 100.0), timing=law)
    assert made, made
    assert replan(made, 0.3 * made.trajectory.duration, stop=True)
for law in ("ruckig", "toppra"):
    try:
        plan(robot, path, q, timing=law)
    except optik.errors.MissingDependency as error:
        print(error)
"""


def test_planning_and_stopping_work_without_ruckig_and_toppra_and_their_laws_say_how_to_install_them() -> None:
    done = subprocess.run([sys.executable, "-c", WITHOUT], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    words = done.stdout.splitlines()
    assert len(words) == 2
    for name, line in zip(("ruckig", "toppra"), words, strict=True):
        assert f"needs the package {name}" in line
        assert "pip install 'optik-toolkit[laws]'" in line


@pytest.mark.parametrize("platform", PLATFORMS)
def test_what_has_no_wheels_on_a_platform_is_not_required_there(platform: str) -> None:
    system, machine, absent = PLATFORMS[platform]
    project = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    for requirement in map(Requirement, project["dependencies"]):
        marker = requirement.marker
        here = marker is None or marker.evaluate({"sys_platform": system, "platform_machine": machine})
        assert here == (requirement.name not in absent), requirement


def test_the_sources_of_every_arm_are_in_the_notice_of_the_wheel() -> None:
    root = Path(__file__).parents[1]
    notice = (root / "NOTICE").read_text(encoding="utf-8")
    assert {file.stem for file in (root / "optik" / "robots").glob("*.toml")} <= set(notice.split())
    assert "NOTICE" in tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["project"]["license-files"]


LIGHT = """
import shlex, sys
for name in ("polars", "plotly", "matplotlib", "pandas", "PIL", "scipy.ndimage"):
    sys.modules[name] = None
import optik, planners
from benchmarks.cli.app import main
for words in sys.argv[1:]:
    sys.argv[1:] = shlex.split(words)
    try:
        main()
    except SystemExit as end:
        print(end.code, file=sys.stderr)
"""


def light(*commands: str, folder: Path) -> list[str]:
    """The error stream of commands where nothing of the extra `bench` is installed; a line with the status ends each."""
    done = subprocess.run(
        [sys.executable, "-c", LIGHT, *commands], capture_output=True, text=True, check=True, cwd=folder
    )
    return done.stderr.splitlines()


def test_what_plans_needs_nothing_of_the_extra_for_comparisons(tmp_path: Path) -> None:
    (tmp_path / "turn.csv").write_text("t,joint1,joint2,joint3,joint4,joint5,joint6\n0,0,0,0,0,0,0\n9,0,0,0,0,0,0.1\n")
    said = light(
        "ik --xyz 0.3,0.2,0.4", "plan line --out line.json", "view line.json --html line.html", "drive line.json", "robots",
        "bench --help", "certify turn.csv", folder=tmp_path,
    )  # fmt: skip
    assert [line for line in said if line.isdigit()] == ["0"] * 6 + ["1"], said


def test_a_comparison_names_the_extra_in_one_line(tmp_path: Path) -> None:
    said = light(
        "bench run paper --out run", "bench list", "bench report run", "bench compare a b", "demo", folder=tmp_path
    )
    assert said[1::2] == ["2"] * 5, said
    assert all(line.endswith("pip install 'optik-toolkit[bench]'") for line in said[::2]), said


def test_an_import_loads_no_package_for_plots_tables_images_or_what_one_method_or_file_needs() -> None:
    code = "import sys, optik, planners, optik.ik.closed_form; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    heavy = {"polars", "pydantic", "plotly", "matplotlib", "pandas", "PIL", "scipy.ndimage", "jinja2", "typer", "rich"}
    heavy |= {"ssik", "eaik", "defusedxml", "optik.arm.urdf", "optik.arm.compare"}
    assert not heavy & set(loaded)
