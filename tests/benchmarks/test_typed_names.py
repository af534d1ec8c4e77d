"""What is typed wrongly is one line that names the option as typed; commands say what a newcomer must know."""

import re
import shlex
from pathlib import Path
from typing import Any

import pytest

from benchmarks.cli.app import COMMAND_PANELS
from tests import forks
from tests.benchmarks.test_command_line import commands

WRONG = {
    "--xyz": ("ik --xyz nan,0,0", "ik --xyz 1,2", "ik --xyz 1e308,0,0", "ik --xyz a"),
    "--rpy-deg": ("ik --xyz 0.3,0.2,0.4 --rpy-deg 1,2",),
    "--solver": ("ik --xyz 0.3,0.2,0.4 --solver nosuch", "plan line --solver ./nosuch.py"),
    "--robot": ("fk 1 --robot nosuch", "ik --xyz 1,2,3 --robot nosuch.urdf"),
    "ROBOT": ("robots nosuch", "robots ./nosuch.urdf"),
    "Q_DEG": ("fk 1,2,3", "fk 1,2,3,4,5,nan"),
    "--timing": ("plan line --timing nosuch", "plan line --timing ./nosuch.py"),
    "--limit": ("plan line --limit nosuch=3", "plan line --limit x", "plan line --limit jerk=1"),
    "--tool-speed": ("plan line --tool-speed 1,2", "plan line --tool-speed 0"),
    "--free": ("plan line --free nosuch", "plan line --free turn=-10"),
    "--via": ("plan arc", "plan polyline", "plan arc --via 0.1,0.3,0.2 --to 0.1,0.3,0.2"),
    "--unit": ("plan polyline --via 0.1,0.3,0.3 --unit mm",),
    "--margin": ("plan line --scene self --margin inf -r panda",),
    "--angle-deg": ("plan arc --centre 0.1,0.3,0.2 --angle-deg 0", "plan arc --centre 0.1,0.3,0.2 --angle-deg nan"),
    "--waypoints": (
        "plan polyline --waypoints nosuch.csv",
        "plan ptp --waypoints nosuch.csv",
        "plan spline --waypoints nosuch.csv",
    ),
    "--tolerance": (
        "plan spline --waypoints nosuch.csv --tolerance 1,0",
        "plan spline --waypoints a.csv --tolerance x",
    ),
    "--set": ("plan path line --set goal=3", "plan path line --set a"),
    "PATH": ("plan path nosuch", "plan path ./nosuch.py"),
    "FILE": ("certify nosuch.csv", "certify nosuch.foo", "view nosuch.json", "view foreign.csv", "view ur5x"),
    "--on": ("drive line.json --on nosuch",),
    "PLAN": ("drive nosuch.json", "drive foreign.csv"),
    "RUN": ("bench report nosuch",),
    "SUITE": ("bench check nosuch",),
    "B": ("bench compare a b", "bench compare none none2"),
    "NAME": ("bench peer nosuch",),
}
USAGE = {
    "nosuch": "No such command 'nosuch'", "plan lin": "Did you mean 'line'", "bench rn": "Did you mean 'run'",
    "--versoin": "--version", "plan --move 1,2,3": "--move",
}  # fmt: skip
"""Unknown commands and options of groups, and a part of the line."""
NUMERIC = (
    "--restarts", "--velocity", "--acceleration", "--jerk", "--samples", "--duration", "--margin", "--rate", "--coefficients",
    "--angle-deg", "--blend", "--stop", "--corrections", "--readings", "--seed", "--workers", "--threshold", "--jobs",
)  # fmt: skip
"""Options of one number."""


@pytest.fixture(name="folder")
def _folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, typed: Any) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "foreign.csv").write_text("# by another program\nt,joint1\n0,0\n1,1\n")
    (tmp_path / "odd.csv").write_text("t,a,b,c,d,e,f\n0,0,0,0,0,0,0\n1,0,0,0,0,0,0\n")
    (tmp_path / "joint_limits.yaml").write_text("joint_limits:\n  joint1: {has_jerk_limits: true, max_jerk: 5}\n")
    rows = "".join(f"0,{i},0,-35,90,25,50,-30\n" for i in range(3))
    (tmp_path / "degrees.csv").write_text(f"observed,index,q1,q2,q3,q4,q5,q6\n{rows}")
    rows = "[configurations]\na = [20, -35, 40, 25, 50, -30]\nb = [0, -35, 40, 25, 50, -30]\n"
    part = '[[part]]\nconfiguration = "b"\navoid = true\n'
    (tmp_path / "avoid.toml").write_text(f'robot = "paper6r"\nstart = "a"\n{rows}{part}')
    return tmp_path


@pytest.mark.parametrize(("option", "words"), [(option, words) for option, each in WRONG.items() for words in each])
def test_an_error_names_the_option_as_typed_in_one_line(option: str, words: str, folder: Path, typed: Any) -> None:
    if "line.json" in words:
        assert typed("plan", "line", "--out", "line.json")[0] == 0
    status, out, said = typed(*words.split())
    assert (status, out) == (2, ""), said
    (line,) = said.strip().splitlines()
    assert line.startswith(f"error: {option}: "), line
    assert not re.search(r"\brad(ians)?\b", line), line


@pytest.mark.parametrize(
    ("words", "wanted"),
    [
        ("plan line --acc 10", "did you mean --acceleration?"),  # a prefix, not what is spelled like it
        ("plan line --vel 1", "did you mean --velocity?"),
        ("certify log.csv --tol 1,1", "did you mean --tolerance?"),
        ("plan line --limit tilt=15", "unknown limit 'tilt'; did you mean open_container or tray?"),  # what they limit
        ("plan line --limit spill=15", "unknown limit 'spill'"),
        ("ik --xyz 0.3,0.2,0.4 --solver LM", "did you mean lm?"),
        ("plan line -r UR5e", "did you mean ur5e"),
        ("bench run speedy", "unknown suite 'speedy'; did you mean ik-speed"),  # before --out is missed
        ("plan line -r ur5e --goal 0.4,0.2,0.5", "did you mean --move?"),  # what is not spelled like the option
        ("plan arc --goal 0.4,0.2,0.5", "did you mean --to?"),
        ("drive line.json --drive mujoco", "did you mean --on?"),
        (
            "drive line.json --robot panda",
            "unknown option --robot; optik drive --help lists the options",
        ),  # nothing is near
        ("plan line -r scara", "unknown robot 'scara'; there are: fr3, "),
        ("fk 0,1,2,3,4,5 ur5e", "unexpected argument ur5e; "),
        ("drive line.json --stop 200ms", "--stop: expected a number [s]; got '200ms'"),
        ("plan ptp --waypoints foreign.csv", "expected a header with q1_deg,…,q6_deg (or q1,… [rad, m])"),
        ("plan --robot ur5e line", "--robot comes after the command: optik plan line --robot …"),
        ("plan line --acceleration 1,2", "--limits joint_limits.yaml has one for each joint"),
        ("plan line --out results/x.json", "create the folder results first"),
        ("plan line --limit open_container=15", "degrees end with deg, as in 15deg"),
        ("plan line --scene self --margin 10 -r panda", "got 10.0; 10 mm are typed as 0.01"),
        ("certify odd.csv", "it has no positions: --columns t,joint1,…,joint6 names all columns"),
        ("certify odd.csv -r panda", "panda has 7 joints: --robot names another arm"),
        ("certify joint_limits.yaml", "expected a trajectory; got joint_limits; --limits reads this file"),
        ("drive foreign.csv", "`optik certify foreign.csv` judges the motion of another program"),
        ("stream degrees.csv --latency 200", "--latency: expected seconds, from 0 to 10; got 200"),
        (
            "stream degrees.csv --jerk 5",
            "degrees.csv, line 1: expected angles [rad]; got q up to 90; are these degrees?",
        ),
        ("stream foreign.csv --ignore joint1", "; of another arm than paper6r: --robot; other names: --columns"),
        (
            "plan program avoid.toml",
            "part 1: scene: expected a Scene with the obstacles to avoid; got None; pass --scene",
        ),
        ("bench run", "SUITE is missing"),
        ("bench run paper", "--out is missing"),
    ],
)
def test_what_was_meant_is_named_in_a_short_line(words: str, wanted: str, folder: Path, typed: Any) -> None:
    status, _, said = typed(*words.split())
    assert status == 2 and wanted in said and said.count("\n") == 1, said
    assert len(said) <= 200, said


@pytest.mark.parametrize("words", USAGE)
def test_what_is_no_command_or_option_is_one_line(words: str, typed: Any) -> None:
    status, out, said = typed(*words.split())
    assert (status, out) == (2, "")
    (line,) = said.strip().splitlines()
    assert line.startswith("error: ") and USAGE[words] in line and re.search(r"; for help: optik.* --help$", line), line


def wrong_commands() -> list[tuple[str, str, str]]:
    """Each command with one mistake: what is typed, how the line begins, and what it must say."""
    found = []
    for words, command in commands().items():
        example = command.epilog.removeprefix("Example: `").removesuffix("`")
        found += [(f"{words} --nosuch 1", "unknown option --nosuch", f"{words} --help")]
        found += [(f"{example} foo bar baz", "unexpected argument", example)]
        needed = [p.opts[0] if p.opts[0].startswith("-") else p.metavar for p in command.params if p.required]
        found += [(words, f"{name} is missing", example) for name in needed[:1]]
        for p in command.params:
            name = max(p.opts, key=len)
            if name.startswith("--") and p.is_flag:
                found += [(f"{example} {name}=3", f"{name} takes no value", "")]
            elif name.startswith("--"):
                found += [(f"{example} {name}", f"{name} needs a value", example)]
                found += [(f"{example} {name}x 1", f"unknown option {name}x", f"did you mean {name}")]
            if name in NUMERIC:
                found += [(f"{example} {name} foo", f"{name}: expected a ", "number")]
                found += [(f"{example} {name}=foo", f"{name}: expected a ", "got 'foo'")]
    return found


@pytest.mark.parametrize("step", [11, pytest.param(1, marks=pytest.mark.soak)])
def test_each_option_that_is_mistyped_is_named_in_one_line_with_what_to_type(
    step: int, folder: Path, typed: Any
) -> None:
    wrong = wrong_commands()
    assert len(wrong) > 500
    for words, begin, advice in wrong[::step]:
        status, out, said = typed(*shlex.split(words)[1:])
        assert (status, out, said.count("\n")) == (2, "", 1), f"{words}: {said}"
        assert said.startswith(f"error: {begin}") and advice in said, f"{words}: {said}"


@pytest.mark.parametrize(
    ("spaces", "commas"),
    [
        ("ik --xyz=0.1 0.3 0.2 --rpy-deg -90 10 20", "ik --xyz=0.1,0.3,0.2 --rpy-deg -90,10,20"),
        ("fk 20 -35 40 25 50 -30", "fk 20,-35,40,25,50,-30"),
        ("fk -20 -35 --json 40 25 50 -30", "fk -20,-35,40,25,50,-30 --json"),
        ("fk -r ur5e --gravity 0,0,1 -1e1 +20 .5 4 5 6", "fk -r ur5e --gravity 0,0,1 -1e1,+20,.5,4,5,6"),
        ("fk --robot irb910sc -- -10 20 30 4", "fk --robot irb910sc -10,20,30,4"),
        ("plan joints --to-deg -1 2 3 4 5 6 --samples 9", "plan joints --to-deg -1,2,3,4,5,6 --samples 9"),
    ],
)
def test_numbers_with_spaces_are_those_with_commas(typed: Any, spaces: str, commas: str) -> None:
    found, expected = (typed(*words.split()) for words in (spaces, commas))
    assert found == expected
    assert found[0] == 0 and found[1]


def test_the_help_lists_what_a_user_needs_first() -> None:
    said = forks.command("--help", COLUMNS="160").stdout
    assert re.findall(r"^│ (\w+) ", said, re.MULTILINE) == [name for names in COMMAND_PANELS.values() for name in names]
    assert {name for name in commands() if " " not in name.removeprefix("optik ")} <= {
        f"optik {w}" for w in said.split()
    }
    assert re.findall(r"^╭─ (.*?) ─", said, re.MULTILINE) == ["Options", *COMMAND_PANELS]
    assert forks.command().returncode == 2
    line = forks.command("plan", "line", "--help", COLUMNS="160").stdout
    assert line.index("--move") < line.index("--turn-deg") < line.index("--free") < line.index("--robot")
    assert "<bool>" not in line.partition("--help")[0]


def test_a_torque_may_be_without_limit_and_a_stop_advises_nothing_of_python(folder: Path, typed: Any) -> None:
    status, _, said = typed("plan", "line", "--torque", "330,330,330,inf,inf,inf", "--out", "line.json")
    assert status == 0, said
    status, out, _ = typed("drive", "line.json", "--stop", "0.05")
    assert status == 0 and "stopped on request" in out and "resume" not in out


def test_a_line_without_a_move_says_that_it_is_a_demonstration(typed: Any) -> None:
    status, _, said = typed("plan", "line")
    assert status == 0 and "a demonstration: --move -0.12,0,0.2; for your own: --robot ROBOT --move X,Y,Z [m]" in said
    assert "demonstration" not in typed("plan", "line", "--move", "-0.1,0,0.1")[2]


def test_a_path_that_ends_far_away_asks_for_its_unit(folder: Path, typed: Any) -> None:
    status, _, said = typed("plan", "line", "--move", "-120,0,200")
    assert (
        status == 1 and "the path ends 233.2 m away, and the arm reaches 0.9452 m; try: coordinates in metres" in said
    )
    for words in ("ik --xyz 500,0,0", "plan polyline --via 100,300,200", "cell --drive ideal --spot 100,300,200"):
        assert "in metres: are these in millimetres?" in typed(*words.split())[2]


def test_a_law_does_not_enforce_what_was_only_given(typed: Any) -> None:
    status, out, _ = typed("plan", "line", "--timing", "toppra", "--jerk", "500")
    assert status == 1 and "enforced by toppra" in out
    assert re.search(r"jerk .*unbounded.* no, but given", out) and re.search(r"velocity .* yes", out)


def test_a_message_that_lasts_longer_than_its_plan_says_so(tmp_path: Path, typed: Any) -> None:
    out = typed("plan", "line", "--rate", "125", "--out", str(tmp_path / "line.yaml"))[1]
    longer = re.search(r"line\.yaml: (\d\.\d{4}) s, ([\d.]+) % longer than the plan", out)
    assert longer is not None, out
    plan = re.search(r"mm in (\d\.\d{4}) s", out)
    assert plan is not None
    assert 100.0 * (float(longer[1]) / float(plan[1]) - 1.0) == pytest.approx(float(longer[2]), abs=0.05)
    assert "longer" not in typed("plan", "line", "--out", str(tmp_path / "line.json"))[1]


def test_a_stop_on_request_is_success(tmp_path: Path, typed: Any) -> None:
    file = str(tmp_path / "line.json")
    assert typed("plan", "line", "--out", file)[0] == 0
    status, out, _ = typed("drive", file, "--stop", "0.05")
    assert status == 0 and "stopped" in out
