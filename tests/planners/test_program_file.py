"""Programs in TOML: what each key means, by hand, and one line for each mistake."""

from pathlib import Path

import numpy as np
import pytest

import optik
import planners
from optik.errors import InvalidInput
from planners import (
    Arc,
    Dwell,
    Move,
    Part,
    PathEvent,
    PeriodicEvent,
    Polyline,
    Spline,
    TimedEvent,
    ToolChange,
    load_program,
)
from planners.program.file import find_mistakes
from tests.oracles import REPOSITORY

HEAD = 'robot = "ur5e"\nstart = "home"\n[configurations]\nhome = [0, -90, 90, -90, -90, 0]\n'
FRAMES = (
    "[frames.cell]\nxyz_mm = [100, 0, 0]\n[frames.table]\nxyz_mm = [0, 200, 0]\nrpy_deg = [0, 0, 90]\nframe = 'cell'\n"
)
BEAD = "x_mm,y_mm,z_mm\n0,0,0\n100,0,0\n100,50,0\n"


def read(folder: Path, text: str, head: str = HEAD + FRAMES) -> planners.program.file.ProgramFile:
    (folder / "bead.csv").write_text(BEAD)
    (folder / "p.toml").write_text(head + text)
    return load_program(folder / "p.toml")


def test_every_key_means_what_its_unit_says(tmp_path: Path) -> None:
    found = read(
        tmp_path,
        """
        [[part]]
        name = "above"
        pose = { frame = "table", xyz_mm = [10, 20, 300], rpy_deg = [180, 0, 0] }
        move = "joint"
        blend_mm = 20
        blend_rotation_deg = 5
        tool_speed_mm_s = 250
        rotation_speed_deg_s = 90
        avoid = true
        [[part]]
        vector_mm = [0, 0, 50]
        [[part]]
        vector_mm = [0, 10, 0]
        frame = "base"
        [[part]]
        dwell_s = 0.5
        [[part]]
        tool = { xyz_mm = [0, 0, 120] }
        payload_kg = 1.5
        payload_com_mm = [0, 0, 50]
        [[part]]
        payload_kg = 0
        [[part]]
        joints = [10, -80, 80, -90, -90, 0]
        [[part]]
        name = "bead"
        polyline = "bead.csv"
        frame = "table"
        within_mm = 0.5
        [[part]]
        spline = "bead.csv"
        [[part]]
        start_of = "bead"
        offset_mm = [0, 0, -40]
        [[part]]
        pose = { xyz_mm = [400, 100, 300], rpy_deg = [180, 0, 0] }
        move = "arc"
        via_mm = [300, 150, 300]
        [[part]]
        configuration = "home"
        [[event]]
        part = "bead"
        distance_mm = -50
        signal = "gun"
        value = 0
        before_s = 0.05
        [[event]]
        part = 1
        fraction = 0.5
        signal = "half"
        [[event]]
        part = "bead"
        spacing_mm = 5
        signal = "shot"
        [[event]]
        time_s = 1.5
        signal = "camera"
        """,
    )
    items = found.program.items
    np.testing.assert_allclose(found.start, np.deg2rad([0, -90, 90, -90, -90, 0]))
    above = items[0]
    assert isinstance(above, Part) and (above.name, above.move, above.avoid) == ("above", "joint", True)
    # The table is at (100, 200, 0) mm and turned by 90° about z: x of the table is y of the base.
    np.testing.assert_allclose(above.goal[:3, 3], [0.1 - 0.02, 0.2 + 0.01, 0.3], atol=1e-12)
    np.testing.assert_allclose(above.goal[:3, 2], [0, 0, -1], atol=1e-12)
    assert above.zone == pytest.approx([0.02, np.deg2rad(5)])
    assert (above.tool_speed, above.rotation_speed) == (0.25, pytest.approx(np.pi / 2))
    assert isinstance(items[1].goal, Move) and items[1].goal.frame == "tool"
    np.testing.assert_allclose(items[2].goal.vector, [0, 0.01, 0])
    assert items[2].goal.frame == "base" and items[3] == Dwell(0.5)
    change = items[4]
    assert isinstance(change, ToolChange)
    arm = change.apply(optik.load("ur5e"))
    np.testing.assert_allclose(arm.tool[:3, 3], [0, 0, 0.12])
    assert arm.payload.mass == 1.5 and items[5].apply(arm).payload is None
    np.testing.assert_allclose(items[6].goal, np.deg2rad([10, -80, 80, -90, -90, 0]))
    bead = items[7].goal
    assert isinstance(bead, Polyline) and isinstance(items[8].goal, Spline) and isinstance(items[10].goal, Arc)
    np.testing.assert_allclose(bead.pose(0.0)[:3, 3], [0.1, 0.2, 0.0], atol=1e-12)
    np.testing.assert_allclose(bead.pose(bead.end)[:3, 3], [0.1 - 0.05, 0.2 + 0.1, 0.0], atol=1e-12)
    begin = bead.pose(0.0)
    np.testing.assert_allclose(items[9].goal[:3, 3], begin[:3, 3] - 0.04 * begin[:3, 2], atol=1e-9)
    np.testing.assert_allclose(items[11].goal, found.start)
    assert found.events == (
        PathEvent("bead", -0.05, "gun", 0, before=0.05), PathEvent(0, None, "half", fraction=0.5),
        PeriodicEvent("bead", 0.005, "shot"), TimedEvent(1.5, "camera"),
    )  # fmt: skip


def test_joints_that_slide_are_in_millimetres(tmp_path: Path) -> None:
    found = read(tmp_path, "[[part]]\njoints = [10, 20, 50, 0]\n", head='robot = "irb910sc"\n')
    np.testing.assert_allclose(found.program.parts[0].goal, [np.deg2rad(10), np.deg2rad(20), 0.05, 0.0])
    assert found.start is None


@pytest.mark.parametrize("name", ["pick_and_place", "weld_seam", "dispensing"])
def test_the_examples_are_planned(name: str) -> None:
    found = load_program(REPOSITORY / "examples" / "programs" / f"{name}.toml")
    limits = planners.MotionLimits.of(found.robot, acceleration=10.0, jerk=100.0)
    plan = planners.plan(found.robot, found.program, found.start, limits=limits)
    assert plan, plan
    assert plan.schedule(found.events).events


PART = "[[part]]\n"
GOOD = PART + "vector_mm = [0, 0, 10]\n"
MISTAKES = [
    # the file
    ("robot = ", "p.toml: expected TOML"),
    ("robotic = 1\n" + GOOD, "got robotic unknown; did you mean robot?"),
    ('robot = "ur5f"\n' + GOOD, "unknown robot 'ur5f'"),
    ("robot = 5\n" + GOOD, "robot: expected a string"),
    (GOOD, "robot: expected the name or the file of an arm; got none"),
    ('robot = "/etc/arm.urdf"\n' + GOOD, "robot: expected a file below the folder"),
    ('robot = "../arm.urdf"\n' + GOOD, "robot: expected a file below the folder"),
    ('robot = "ur5e"\n', "items: expected a list of Part"),
    ('robot = "ur5e"\npart = 3\n', "part: expected a list of tables"),
    ('robot = "ur5e"\npart = [3]\n', "[[part]] 1: part: expected a table"),
    ('robot = "ur5e"\nstart = "hom"\n' + GOOD, "configuration: expected one of: none in the file; got 'hom'"),
    ('robot = "ur5e"\nstart = [1, 2]\n' + GOOD, "start: expected 6 finite numbers"),
    ('robot = "ur5e"\nstart = 3\n' + GOOD, "start: expected 6 finite numbers"),
]
PARTS = [
    ("", "[[part]] 1: goal: expected one of: joints, configuration"),
    ("vectr_mm = [0, 0, 1]\n", "[[part]] 1: goal: "),
    ("name = 'x'\n", "[[part]] 1 'x': goal: "),
    ("vector_mm = [0, 0, 1]\njoints = [0, 0, 0, 0, 0, 0]\n", "[[part]] 1: goal: expected one of"),
    ("vector_mm = [0, 0]\n", "[[part]] 1: vector_mm: expected 3 finite numbers"),
    ("vector_mm = [0, 0, nan]\n", "[[part]] 1: vector_mm: "),
    ("vector_mm = 'up'\n", "[[part]] 1: vector_mm: "),
    ("vector_mm = [0, 0, 1]\nframe = 'table'\n", '[[part]] 1: frame: expected "tool" or "base"'),
    ("vector_mm = [0, 0, 1]\nblend = 3\n", "got blend unknown; did you mean blend_mm?"),
    ("vector_mm = [0, 0, 1]\nspeed = 3\n", "[[part]] 1: keys: expected a mapping with vector_mm"),
    ("vector_mm = [0, 0, 1]\nblend_mm = -1\n", "[[part]] 1: blend: "),
    ("vector_mm = [0, 0, 1]\nblend_mm = '2'\n", "[[part]] 1: blend_mm: "),
    ("vector_mm = [0, 0, 1]\nblend_mm = true\n", "[[part]] 1: blend_mm: "),
    ("vector_mm = [0, 0, 1]\nblend_rotation_deg = 3\n", "[[part]] 1: blend_rotation: "),
    ("vector_mm = [0, 0, 1]\ntool_speed_mm_s = 0\n", "[[part]] 1: tool_speed: "),
    ("vector_mm = [0, 0, 1]\nrotation_speed_deg_s = -3\n", "[[part]] 1: rotation_speed: "),
    ("vector_mm = [0, 0, 1]\navoid = true\n", "[[part]] 1: avoid: expected False for a Move"),
    ("vector_mm = [0, 0, 1]\navoid = 'yes'\n", "[[part]] 1: avoid: expected True or False"),
    ("vector_mm = [0, 0, 1]\nmove = 'joint'\n", "got move unknown"),
    ("vector_mm = [0, 0, 1]\nname = 3\n", "[[part]] 1: name: "),
    ("joints = [0, 0, 0]\n", "[[part]] 1: joints: expected 6 finite numbers"),
    ("joints = 'home'\n", "[[part]] 1: joints: "),
    ("configuration = 'away'\n", "[[part]] 1: configuration: expected one of: home; got 'away'"),
    ("configuration = 3\n", "[[part]] 1: configuration: "),
    ("pose = [0, 0, 1]\n", "[[part]] 1: pose: expected a mapping with frame, xyz_mm, rpy_deg"),
    ("pose = { xyz = [0, 0, 1] }\n", "got xyz unknown; did you mean xyz_mm?"),
    ("pose = { xyz_mm = [0, 0] }\n", "[[part]] 1: pose.xyz_mm: "),
    ("pose = { rpy_deg = 3 }\n", "[[part]] 1: pose.rpy_deg: "),
    ("pose = { frame = 'tabel' }\n", "[[part]] 1: pose.frame: expected one of: "),
    ("pose = { xyz_mm = [0, 0, 1] }\nmove = 'spline'\n", '[[part]] 1: move: expected "line" or "joint"'),
    ("pose = { xyz_mm = [0, 0, 1] }\nmove = 'arc'\n", "[[part]] 1: move: expected via_mm"),
    ("pose = { xyz_mm = [0, 0, 1] }\nvia_mm = [0, 0, 2]\n", "[[part]] 1: via_mm: expected none, or move"),
    ("polyline = 'none.csv'\n", "[[part]] 1: "),
    ("polyline = '../bead.csv'\n", "[[part]] 1: polyline: expected a file below the folder"),
    ("polyline = '/bead.csv'\n", "[[part]] 1: polyline: expected a file below the folder"),
    ("polyline = 3\n", "[[part]] 1: polyline: expected a string"),
    ("spline = 'bead.csv'\nwithin_mm = -1\n", "[[part]] 1: "),
    ("polyline = 'bead.csv'\nframe = 'x'\n", "[[part]] 1: frame: expected one of"),
    ("polyline = 'bead.csv'\noffset_mm = [0, 0, 1]\n", "got offset_mm unknown"),
    ("start_of = 'bead'\n", "[[part]] 1: start_of: expected the name of a part with a table: none in the file"),
    ("dwell_s = -1\n", "[[part]] 1: dwell_s: expected seconds"),
    ("dwell_s = 1\nblend_mm = 2\n", "[[part]] 1: keys: expected a mapping with dwell_s; got blend_mm unknown"),
    ("payload_kg = -1\n", "[[part]] 1: payload_kg: "),
    ("payload_com_mm = [0, 0, 1]\n", "[[part]] 1: payload_com_mm: expected payload_kg, too"),
    ("tool = { xyz_mm = [0, 0, 1] }\nname = 'x'\n", "[[part]] 1 'x': keys: expected a mapping with tool"),
    ("tool = 3\n", "[[part]] 1: tool: expected a mapping"),
]
OTHERS = [
    (
        GOOD.replace("10]\n", "10]\nblend_mm = 2\n"),
        "blend: expected blend=0: the arm stops there; got 0.002 m at the last part (part 1)",
    ),
    (2 * GOOD.replace("10]\n", "10]\nname = 'x'\n"), "name: expected a name for one part; got 'x' for two parts"),
    (GOOD + "[[event]]\n", "[[event]] 1: event: expected signal; and time_s"),
    (GOOD + "[[event]]\nsignal = 'a'\n", "[[event]] 1: event: "),
    (GOOD + "[[event]]\nsignal = 3\ntime_s = 1\n", "[[event]] 1: signal: "),
    (GOOD + "[[event]]\nsignal = 'a'\ntime_s = -1\n", "[[event]] 1: t: "),
    (GOOD + "[[event]]\nsignal = 'a'\npart = 1\nfraction = 2\n", "[[event]] 1: fraction: "),
    (GOOD + "[[event]]\nsignal = 'a'\npart = 1\nspacing_mm = 0\n", "[[event]] 1: spacing: "),
    (GOOD + "[[event]]\nsignal = 'a'\npart = 1\ntime_s = 1\n", "[[event]] 1: event: "),
    (GOOD + "[[event]]\nsignl = 'a'\n", "got signl unknown; did you mean signal?"),
]


@pytest.mark.parametrize(
    ("head", "text", "words"),
    [("", text, words) for text, words in MISTAKES]
    + [(HEAD + FRAMES, PART + text, words) for text, words in PARTS]
    + [(HEAD + FRAMES, text, words) for text, words in OTHERS],
)
def test_a_mistake_is_one_line_with_part_key_and_reason(tmp_path: Path, head: str, text: str, words: str) -> None:
    with pytest.raises(InvalidInput) as caught:
        read(tmp_path, text, head)
    said = str(caught.value)
    assert words in said and "p.toml" in said and "\n" not in said, said


@pytest.mark.parametrize(
    "name", ["arm.py", "./arm.py", "arm.urdf.xacro", "robot_descriptions:ur5e_description", "x.py:ARM"]
)
def test_no_code_is_run_for_the_arm_that_a_file_names(tmp_path: Path, name: str) -> None:
    for file in ("arm.py", "x.py", "arm.urdf.xacro"):
        (tmp_path / file).write_text(f"open({str(tmp_path / 'ran')!r}, 'w')\n")
    with pytest.raises(InvalidInput, match="robot: expected a name"):
        read(tmp_path, GOOD, f'robot = "{name}"\n')
    assert not (tmp_path / "ran").exists()


def test_frames_that_refer_to_each_other_are_refused(tmp_path: Path) -> None:
    frames = "[frames.a]\nframe = 'b'\n[frames.b]\nframe = 'a'\n"
    with pytest.raises(InvalidInput, match=r"frames\.b\.frame: expected one of: "):
        read(tmp_path, PART + "pose = { frame = 'a' }\n", HEAD + frames)


def test_all_mistakes_of_a_file_are_found_and_none_follows_from_another(tmp_path: Path) -> None:
    (tmp_path / "p.toml").write_text(
        HEAD
        + PART
        + "blend = 1\n"
        + PART
        + "vector_mm = [0, 0]\n"
        + GOOD
        + PART
        + "pose = { xyz_mm = [-400, 0, 300], rpy_deg = [180, 0, 10] }\n"
        "move = 'arc'\nvia_mm = [-450, -50, 400]\n" + PART + "dwell_s = -1\n[[event]]\nsignal = 'a'\n"
    )
    found = [str(mistake).removeprefix(f"{tmp_path / 'p.toml'}: ") for mistake in find_mistakes(tmp_path / "p.toml")]
    assert [words.split(":")[0] for words in found] == ["[[part]] 1", "[[part]] 2", "[[part]] 5", "[[event]] 1"]
    with pytest.raises(InvalidInput, match=r"\[\[part\]\] 1: goal"):
        load_program(tmp_path / "p.toml")
