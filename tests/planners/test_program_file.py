"""Programs in TOML: what each key means, by hand, and one line for each mistake."""

from pathlib import Path

import numpy as np
import pytest

import optik
import planners
from optik.errors import AssumptionWarning, InvalidInput
from planners import Arc, Part, Polyline, Spline, load_program
from planners.program import Dwell, Move, PathEvent, PeriodicEvent, TimedEvent, ToolChange
from planners.program.file import read_program
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


def mistakes(folder: Path) -> list[InvalidInput]:
    return read_program(folder / "p.toml")[1]


@pytest.mark.parametrize(
    "turn", ["quaternion_wxyz = [0, 1, 0, 0]", "quaternion_xyzw = [1, 0, 0, 0]", "abc_deg = [0, 0, 180]"]
)
def test_poses_frames_and_tools_have_any_orientation(turn: str, tmp_path: Path) -> None:
    tables = "[[part]]\npose = { frame = 'table', xyz_mm = [10, 20, 300], TURN }\n[[part]]\ntool = { TURN }\n"
    tables += "[[part]]\nvector_mm = [0, 0, 9]"
    first, second = (
        read(tmp_path, tables.replace("TURN", words)).program.items for words in (turn, "rpy_deg = [180, 0, 0]")
    )
    np.testing.assert_allclose(first[0].goal, second[0].goal, rtol=0, atol=1e-15)
    np.testing.assert_allclose(first[1].tool, second[1].tool, rtol=0, atol=1e-15)


def test_radians_that_are_typed_as_degrees_are_asked_for(tmp_path: Path) -> None:
    with pytest.warns(
        AssumptionWarning, match=r"joints: angles of at most 1.57° are read as degrees; are these radians\?"
    ):
        found = read(tmp_path, "[[part]]\njoints = [0.3, -1.57, 1.5, -1.57, -1.57, 0]\n")
    np.testing.assert_allclose(found.program.items[0].goal[1], np.deg2rad(-1.57), rtol=0, atol=1e-15)
    read(tmp_path, "[[part]]\njoints = [1, -2, 3, 0, 0, 0]\n")  # whole degrees are meant


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
        after_s = 0.2
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
        PathEvent("bead", -0.05, "gun", 0, before=0.05), PathEvent(0, None, "half", fraction=0.5, after=0.2),
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
    ('robot = "ur5e"\n', "p.toml: [[part]]: expected at least one with a goal: joints, "),
    ('robot = "ur5e"\npart = 3\n', "part: expected a list of tables"),
    ('robot = "ur5e"\npart = [3]\n', "[[part]] 1: part: expected a table"),
    ('robot = "ur5e"\nstart = "hom"\n' + GOOD, "p.toml: start: expected one of: none in the file; got 'hom'"),
    ('robot = "ur5e"\nstart = [1, 2]\n' + GOOD, "start: expected 6 finite numbers"),
    ('robot = "ur5e"\nstart = 3\n' + GOOD, "start: expected 6 finite numbers"),
    (
        'robot = "ur5e"\nstart = [0, 0, 0, 0, 0, 400]\n' + GOOD,
        "start: expected joint6 within [-360, 360]°, its range; got joint6 = 400°",
    ),
    (HEAD.replace('"home"', '"hoem"') + GOOD, "p.toml: start: expected one of: home; got 'hoem'; did you mean home?"),
    (
        HEAD.replace('"ur5e"', '"kr6"').replace("-90, 0]", "10, 0]") + "[[part]]\npayload_kg = 2\n",
        "[[part]] 1: payload_kg: expected an arm with masses (in its file), or no payload_kg; got 2 on kr6",
    ),
]
PARTS = [
    ("", "[[part]] 1: goal: expected one of: joints, configuration"),
    ("vectr_mm = [0, 0, 1]\n", "got none among the keys vectr_mm; did you mean vector_mm?"),
    ("vector_m = [0, 0, 1]\nblend_mm = 1\n", "did you mean vector_mm?"),
    ("dwell_ms = 1\n", "did you mean dwell_s?"),
    (
        "joints = [0, -90, 500, 0, 0, 0]\n",
        "[[part]] 1: joints: expected joint3 within [-360, 360]°, its range; got joint3 = 500°",
    ),
    ("name = 'x'\n", "[[part]] 1 'x': goal: "),
    ("vector_mm = [0, 0, 1]\njoints = [0, 0, 0, 0, 0, 0]\n", "[[part]] 1: goal: expected one of"),
    ("vector_mm = [0, 0]\n", "[[part]] 1: vector_mm: expected 3 finite numbers"),
    ("vector_mm = [0, 0, nan]\n", "[[part]] 1: vector_mm: "),
    ("vector_mm = 'up'\n", "[[part]] 1: vector_mm: "),
    ("vector_mm = [0, 0, 1]\nframe = 'table'\n", '[[part]] 1: frame: expected "tool" or "base"'),
    ("vector_mm = [0, 0, 1]\nblend = 3\n", "got blend unknown; did you mean blend_mm?"),
    ("vector_mm = [0, 0, 1]\nspeed = 3\n", "[[part]] 1: keys: expected a mapping with vector_mm"),
    ("vector_mm = [0, 0, 1]\nblend_mm = -1\n", "[[part]] 1: blend_mm: expected a number of at least 0 [mm]; got -1"),
    ("vector_mm = [0, 0, 1]\nblend_mm = '2'\n", "[[part]] 1: blend_mm: "),
    ("vector_mm = [0, 0, 1]\nblend_mm = true\n", "[[part]] 1: blend_mm: "),
    (
        "vector_mm = [0, 0, 1]\nblend_rotation_deg = 3\n",
        "[[part]] 1: blend_rotation_deg: expected blend_mm, too; got 3 without",
    ),
    ("vector_mm = [0, 0, 1]\ntool_speed_mm_s = 0\n", "tool_speed_mm_s: expected a number above 0 [mm/s]; got 0"),
    (
        "vector_mm = [0, 0, 1]\nrotation_speed_deg_s = -3\n",
        "rotation_speed_deg_s: expected a number above 0 [°/s]; got -3",
    ),
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
    (
        "pose = { frame = 'tabel' }\n",
        "[[part]] 1: pose.frame: expected one of: cell, table; got 'tabel'; did you mean table?",
    ),
    ("pose = { xyz_mm = [0, 0, 1] }\nmove = 'spline'\n", '[[part]] 1: move: expected "line", "joint" or "arc"; got'),
    ("pose = { xyz_mm = [0, 0, 1] }\nmove = 'arc'\n", "[[part]] 1: via_mm: expected a point of the arc; got none"),
    ("pose = { xyz_mm = [0, 0, 1] }\nvia_mm = [0, 0, 2]\n", "[[part]] 1: via_mm: expected none, or move"),
    ("polyline = 'none.csv'\n", "[[part]] 1: polyline: expected a readable file; got "),
    ("polyline = 'bead.csv'\nwithin_mm = -1\n", "[[part]] 1: within_mm: expected a number above 0 [mm]; got -1"),
    ("configuration = [1]\n", "[[part]] 1: configuration: expected one of: home; got [1]"),
    ("polyline = '../bead.csv'\n", "[[part]] 1: polyline: expected a file below the folder"),
    ("polyline = '/bead.csv'\n", "[[part]] 1: polyline: expected a file below the folder"),
    ("polyline = 3\n", "[[part]] 1: polyline: expected a string"),
    ("spline = 'bead.csv'\nwithin_mm = -1\n", "[[part]] 1: "),
    ("polyline = 'bead.csv'\nframe = 'x'\n", "[[part]] 1: frame: expected one of"),
    ("polyline = 'bead.csv'\noffset_mm = [0, 0, 1]\n", "got offset_mm unknown"),
    ("start_of = 'bead'\n", "[[part]] 1: start_of: expected the name of a part with a table: none in the file"),
    ("dwell_s = -1\n", "[[part]] 1: dwell_s: expected a number of at least 0 [s]; got -1"),
    ("dwell_s = 1\nblend_mm = 2\n", "[[part]] 1: keys: expected a mapping with dwell_s; got blend_mm unknown"),
    ("payload_kg = -1\n", "[[part]] 1: payload_kg: expected a number of at least 0 [kg]; got -1"),
    ("tool = { frame = 'table', xyz_mm = [0, 0, 1] }\n", "rotation_vector_rad, abc_deg; got frame unknown"),
    ("payload_com_mm = [0, 0, 1]\n", "[[part]] 1: payload_com_mm: expected payload_kg, too"),
    ("tool = { xyz_mm = [0, 0, 1] }\nname = 'x'\n", "[[part]] 1 'x': keys: expected a mapping with tool"),
    ("tool = 3\n", "[[part]] 1: tool: expected a mapping"),
]
OTHERS = [
    (
        GOOD.replace("10]\n", "10]\nblend_mm = 2\n"),
        "[[part]] 1: blend_mm: expected 0, or none: the arm stops there; got 2 at the last part",
    ),
    (
        2 * (PART + "dwell_s = 1\n") + GOOD + "blend_mm = 5\n" + PART + "dwell_s = 1\n" + GOOD,
        "[[part]] 3: blend_mm: expected 0, or none: the arm stops there; got 5 before a wait",
    ),
    (2 * GOOD.replace("10]\n", "10]\nname = 'x'\n"), "name: expected a name for one part; got 'x' for two parts"),
    (GOOD + "[[event]]\n", "[[event]] 1: event: expected signal; and time_s"),
    (GOOD + "[[event]]\n", "fraction or spacing_mm; got no keys"),
    (GOOD + "[[event]]\nsignal = 'a'\npart = 1\n", "fraction or spacing_mm; got signal, part"),
    (GOOD + "[[event]]\nsignal = 'a'\n", "[[event]] 1: event: "),
    (GOOD + "[[event]]\nsignal = 3\ntime_s = 1\n", "[[event]] 1: signal: "),
    (
        GOOD + "[[event]]\nsignal = 'a'\ntime_s = -1\n",
        "[[event]] 1: time_s: expected a number of at least 0 [s]; got -1",
    ),
    (GOOD + "[[event]]\nsignal = 'a'\npart = 1\nfraction = 2\n", "[[event]] 1: fraction: "),
    (
        GOOD + "[[event]]\nsignal = 'a'\npart = 1\nspacing_mm = 0\n",
        "[[event]] 1: spacing_mm: expected a number above 0 [mm]; got 0",
    ),
    (
        GOOD + "[[event]]\nsignal = 'a'\npart = 1\nfraction = 1\nbefore_s = -1\n",
        "[[event]] 1: before_s: expected a number",
    ),
    (
        GOOD + "[[event]]\nsignal = 'a'\npart = 1\n",
        "[[event]] 1: event: expected signal; and time_s, or part with distance_mm, fraction or spacing_mm; got signal, part",
    ),
    (GOOD + "[[event]]\n", "fraction or spacing_mm; got no keys"),
    (
        GOOD + "[[event]]\nsignal = 'a'\npart = 1\nspacing_mm = 9\nafter_s = 1\n",
        "after_s: expected no after_s, or a place by distance_mm or fraction; got 1 with spacing_mm",
    ),
    (
        GOOD + "[[event]]\nsignal = 'a'\ntime_s = 1\nbefore_s = 1\n",
        "before_s: expected no before_s, or a place by distance_mm or fraction",
    ),
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
    with pytest.raises(
        InvalidInput, match=r"p.toml: frames\.b\.frame: expected a frame .*; got the cycle a -> b -> a$"
    ):
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
    found = [str(mistake).removeprefix(f"{tmp_path / 'p.toml'}: ") for mistake in mistakes(tmp_path)]
    assert [words.split(":")[0] for words in found] == ["[[part]] 1", "[[part]] 2", "[[part]] 5", "[[event]] 1"]
    with pytest.raises(InvalidInput, match=r"\[\[part\]\] 1: goal"):
        load_program(tmp_path / "p.toml")


def test_a_mistake_that_several_parts_meet_is_one_line_at_its_own_place(tmp_path: Path) -> None:
    goals = 2 * "[[part]]\nstart_of = 'bead'\n" + "[[part]]\nname = 'bead'\npolyline = 'bead.csv'\nframe = 'table'\n"
    for head, text, words in (
        (HEAD + FRAMES, goals.replace("bead.csv", "none.csv"), "[[part]] 3 'bead': polyline: expected a readable file"),
        (HEAD + FRAMES.replace("rpy_deg", "rpy"), goals, "frames.table: expected known keys; got rpy unknown; did"),
        (HEAD.replace('start = "home"\n', "") + FRAMES, goals, "start: expected joints or a configuration, because bead.csv "),
    ):  # fmt: skip
        with pytest.raises(InvalidInput):
            read(tmp_path, text, head)
        (found,) = mistakes(tmp_path)
        assert str(found).startswith(f"{tmp_path / 'p.toml'}: {words}"), found


EVENT_PARTS = (
    "[[part]]\nname = 'go'\nconfiguration = 'home'\n[[part]]\nname = 'down'\nvector_mm = [0, 0, 40]\n[[part]]\ndwell_s = 1\n"
    "[[part]]\nname = 'side'\npose = { xyz_mm = [-500, -200, 300], rpy_deg = [180, 0, 10] }\n"
)


@pytest.mark.parametrize("place", ["fraction = 0.5", "distance_mm = 1"])
@pytest.mark.parametrize("part", ['"dwon"', "9", "0", "-1", "1.5", '"3"', "true", "4"])
def test_an_event_of_a_part_that_does_not_exist_is_refused(tmp_path: Path, part: str, place: str) -> None:
    got = {'"dwon"': "'dwon'", '"3"': "'3'", "true": "True"}.get(part, part)
    words = f"[[event]] 1: part: expected 1 to 3, or 'go', 'down', 'side'; got {got}"
    with pytest.raises(InvalidInput) as caught:
        read(tmp_path, EVENT_PARTS + f"[[event]]\npart = {part}\nsignal = 's'\n{place}\n")
    assert str(caught.value).endswith(words)


@pytest.mark.parametrize(
    ("place", "words"),
    [
        ("part = 2\ndistance_mm = 40", ""),
        ("part = 2\ndistance_mm = -40.1", "distance_mm: expected at most the length of part 2, 40 mm; got -40.1"),
        ("part = 'side'\ndistance_mm = 1000", "distance_mm: expected at most the length of part 'side', "),
        (
            "part = 'go'\ndistance_mm = 0",
            "distance_mm: expected fraction, from 0 to 1; got 0 along part 'go', which is in joint",
        ),
        ("part = 'go'\nspacing_mm = 5", "spacing_mm: expected fraction, from 0 to 1; got 5 along part 'go'"),
        ("part = 2\nspacing_mm = 1e-6", "spacing_mm: expected at least 4e-05 mm along part 2; got 1e-06"),
    ],
)
def test_the_place_of_an_event_is_checked_in_the_units_of_the_file(tmp_path: Path, place: str, words: str) -> None:
    text = EVENT_PARTS + f"[[event]]\nsignal = 's'\n{place}\n"
    if not words:
        assert read(tmp_path, text).events
        return
    with pytest.raises(InvalidInput) as caught:
        read(tmp_path, text)
    assert f"p.toml: [[event]] 1: {words}" in str(caught.value)


def test_a_byte_order_mark_and_another_start_are_read(tmp_path: Path) -> None:
    text = "\ufeff" + HEAD + FRAMES + EVENT_PARTS.replace("[[part]]\nname = 'go'\nconfiguration = 'home'\n", "", 1)
    (tmp_path / "p.toml").write_text(text, encoding="utf-8")
    start = np.deg2rad([10.0, -80, 90, -90, -90, 0])
    np.testing.assert_array_equal(load_program(tmp_path / "p.toml", start=start).start, start)
