"""Robot files of other people: the tip that is taken, unused xacro, text that is not UTF-8, and SRDF of MoveIt."""

import itertools
import re

import numpy as np
import pytest

import optik
from optik import Robot
from optik.errors import InvalidInput, RobotModelError
from tests.optik.test_urdf import LIMIT, arm, joint

MIMIC = LIMIT + '<mimic joint="finger1" multiplier="-1"/>'


def fixed(parent, child):
    return joint(0, "fixed", '<origin xyz="0 0 0.1"/>', f"{parent}_{child}", parent, child)


def tree(n, *rest, first=0, name="arm"):
    """URDF of joints j0 to j{n − 1} between link0 and link{n}, and other joints, with their links."""
    joints = [*(joint(i, inside='<origin xyz="0.1 0 0.2"/><axis xyz="0 1 0"/>' + LIMIT) for i in range(n)), *rest]
    names = {text.split('link="')[k].split('"')[0] for text in joints for k in (1, 2)}
    return arm(*joints, *(f'<link name="{x}"/>' for x in names - {"link0"}), links=1, name=name)


def finger(i, parent, inside=LIMIT, kind="prismatic", name="finger"):
    return joint(0, kind, inside, f"{name}{i}", parent, f"{name}_link{i}")


def chain(side, n, parent="link0"):
    """An arm beside others: side1 to side{n}."""
    links = [parent, *(f"{side}{i + 1}" for i in range(n))]
    return [joint(0, name=f"{side}_j{i}", parent=links[i], child=links[i + 1]) for i in range(n)]


def with_stiffness(n):
    """An arm each of whose links carries a joint beside the chain, as descriptions with a stiffness have."""
    return tree(n, *(finger(i, f"link{i}", name="stiffness") for i in range(n)))


NAMED = "chosen by its name"
ONLY, LAST, END = "the only end before the hand", "the last link before the hand", "the end of the longest chain"
HAND = (finger(1, "hand"), finger(2, "hand", MIMIC))
TIPS = {
    "one chain": (tree(3), "link3", 3, ""),
    "a base frame without joints": (tree(6, fixed("link0", "base")), "link6", 6, END),
    "a base frame beside the only chain": (tree(6, fixed("link0", "base"), fixed("link6", "tool0")), "tool0", 6, NAMED),
    "a camera on the arm": (tree(6, fixed("link3", "eye"), fixed("link6", "tcp")), "tcp", 6, END),
    "a camera on the last link": (tree(6, fixed("link6", "camera_link"), fixed("camera_link", "optical")), "link6", 6, END),
    "two tool frames": (tree(6, fixed("link6", "flange"), fixed("flange", "tool0"), fixed("link6", "ee")), "tool0", 6, NAMED),
    "a flange beside another frame": (tree(6, fixed("link6", "ur_flange"), fixed("link6", "ee")), "ur_flange", 6, NAMED),
    "a sensor before the tool": (tree(6, fixed("link6", "ft_sensor"), fixed("ft_sensor", "tcp")), "tcp", 6, ""),
    "a hand at the flange": (tree(7, fixed("link7", "link8"), fixed("link8", "hand"), *HAND), "hand", 7, LAST),
    "a hand with a tool frame": (tree(7, fixed("link7", "hand"), fixed("hand", "tcp"), *HAND), "tcp", 7, ONLY),
    "a hand behind tool0": (tree(6, fixed("link6", "tool0"), fixed("tool0", "hand"), *HAND), "tool0", 6, NAMED),
    "a hand with two frames": (tree(6, fixed("link6", "hand"), fixed("hand", "a"), fixed("hand", "b"), *HAND), "hand", 6, LAST),
    "a mimic finger alone": (tree(5, finger(2, "link5", MIMIC), finger(1, "link5")), "link5", 5, LAST),
    "fingers as long as the arm": (tree(3, *chain("a", 3, "link3"), *chain("b", 3, "link3")), "link3", 3, LAST),
    "one jaw": (tree(5, fixed("link5", "frame"), finger(1, "link5", kind="revolute", name="Jaw")), "frame", 5, ONLY),
    "a screwdriver behind tool0": (tree(6, fixed("link6", "tool0"), finger(1, "tool0", name="bit")), "tool0", 6, NAMED),
    "jointed fingers and a longer thumb": (
        tree(7, *chain("index", 3, "link7"), *chain("middle", 3, "link7"), *chain("opposed", 4, "link7")), "link7", 7, LAST
    ),
    "a linkage beside the arm": (tree(6, *chain("rod", 2, "link1"), fixed("link6", "tool0")), "tool0", 6, NAMED),
    "an arm on wheels": (tree(6, *(j for i in range(4) for j in chain(f"wheel{i}_", 1))), "link6", 6, END),
    "joints of a stiffness": (
        re.sub(r'(<link name="link[0-9]")/>', r'\1><visual/></link>', with_stiffness(7)), "link7", 7, END
    ),
    "two flanges, one of this very name": (
        tree(6, fixed("link6", "maker_flange"), fixed("link6", "flange")), "flange", 6, NAMED
    ),
    "a flange for a camera": (
        tree(6, fixed("link6", "camera_flange"), fixed("link6", "link6_flange")), "link6_flange", 6, NAMED
    ),
    "a flange for a camera alone": (tree(6, fixed("link6", "camera_flange"), fixed("link6", "tcp")), "tcp", 6, END),
    "casters and a mast": (tree(8, *chain("caster", 2), *chain("head", 2, "link1")), "link8", 8, END),
}  # fmt: skip


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(("text", "tip", "n", "reason"), TIPS.values(), ids=TIPS.keys())
def test_a_rule_takes_the_tip_that_people_mean_and_says_which(text, tip, n, reason):
    robot = Robot.from_urdf(text)
    assert robot.joint_names == tuple(f"j{i}" for i in range(n))
    assert robot == Robot.from_urdf(text, tip)
    said = f"from link0 to {tip}" + (f", {reason}; tip= selects another" if reason else "")
    assert str(robot).splitlines()[-1] == f"Source: {robot.source}" and robot.source.endswith(said)
    assert Robot.from_dict(robot.to_dict()).source == robot.source


LISTS = {
    "two arms": (tree(0, *chain("left", 6), *chain("right", 6)), "left6 (6 joints), right6 (6 joints)"),
    "two arms on a mast": (
        tree(1, *chain("left", 6, "link1"), *chain("right", 7, "link1"), *chain("head", 2, "link1")),
        "right7 (8 joints), left6 (7 joints)",
    ),
    "two arms with hands": (
        tree(0, *chain("a", 6), *chain("b", 6), *(finger(i, "a6") for i in (1, 2)), *(finger(i, "b6") for i in (3, 4))),
        "a6 (6 joints), b6 (6 joints)",
    ),
    "two frames of which neither is called tool0": (
        tree(7, fixed("link7", "ee"), fixed("link7", "ee_kuka"), fixed("link0", "base")),
        "ee (7 joints), ee_kuka (7 joints)",
    ),
    "two tool0": (
        tree(6, fixed("link6", "a_tool0"), fixed("link6", "b_tool0")), "a_tool0 (6 joints), b_tool0 (6 joints)"
    ),
    "joints of a stiffness, without a sign of which": (
        with_stiffness(7), "link7 (7 joints), stiffness_link6 (7 joints)"
    ),
    "fingers without an arm": (tree(0, *chain("x", 3), *chain("y", 3)), "x3 (3 joints), y3 (3 joints)"),
}  # fmt: skip


@pytest.mark.parametrize(("text", "words"), LISTS.values(), ids=LISTS.keys())
def test_without_a_rule_one_line_lists_the_usable_tips_and_how_to_take_one(text, words):
    with pytest.raises(RobotModelError) as caught:
        Robot.from_urdf(text)
    first = words.split(" ")[0]
    assert caught.value.problem == f"possible tips are {words}; for the first: tip={first!r}"
    for part in words.split("), "):
        link, count = part.split(" (")
        assert Robot.from_urdf(text, link).n == int(count.split(" ")[0])


def test_a_chain_behind_a_mimic_joint_is_no_tip_and_alone_it_follows():
    text = tree(1, *chain("left", 3, "link1"), *chain("right", 3, "link1"))
    follows = text.replace('"left1"/>' + LIMIT, '"left1"/>' + LIMIT + '<mimic joint="right_j0"/>')
    assert Robot.from_urdf(follows).joint_names == ("j0", "right_j0", "right_j1", "right_j2")
    palletiser = tree(3).replace(LIMIT + "</joint>", LIMIT + '<mimic joint="j0" multiplier="-1"/></joint>', 3)
    palletiser = palletiser.replace('<mimic joint="j0" multiplier="-1"/>', "", 1)
    assert Robot.from_urdf(palletiser).joint_names == ("j0",)
    several = follows.replace('"right1"/>' + LIMIT, '"right1"/>' + LIMIT + '<mimic joint="j0"/>')
    with pytest.raises(RobotModelError, match="possible tips are left"):
        Robot.from_urdf(several)


def test_the_base_is_where_the_chain_begins_for_the_tip_too():
    text = tree(0, *chain("left", 6), *chain("right", 6))
    assert Robot.from_urdf(text, base="right1", gravity=(0, 0, -1)).joint_names == tuple(
        f"right_j{i}" for i in range(1, 6)
    )


def test_errors_of_a_file_name_it(tmp_path):
    file = tmp_path / "two.urdf"
    file.write_text(LISTS["two arms"][0])
    for load in (optik.load, Robot.from_urdf):
        with pytest.raises(RobotModelError, match=r"^robot 'arm' in .*two\.urdf: possible tips") as caught:
            load(file)
        assert caught.value.file == str(file)
    with pytest.raises(RobotModelError, match=r"^robot 'arm' in .*two\.urdf: no <collision>"):
        optik.Scene.load(file)
    file.write_text("<robot")
    with pytest.raises(InvalidInput, match=r"^two\.urdf: source: "):
        optik.Scene.load(file)


# ---------------------------------------------------------------- xacro and encodings
PROPERTY = '<xacro:property name="pi" value="3.14"/>'


def in_xacro(inside, attributes=' xmlns:xacro="http://www.ros.org/wiki/xacro"'):
    return tree(2).replace('<robot name="arm">', f'<robot name="arm"{attributes}>{inside}')


@pytest.mark.parametrize(
    "text", [in_xacro(""), in_xacro(PROPERTY), in_xacro(f"<gazebo>{PROPERTY}<a>${{pi}}</a></gazebo>")]
)
def test_xacro_that_nothing_uses_is_ignored(text):
    assert Robot.from_urdf(text) == Robot.from_urdf(tree(2))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        *((in_xacro(PROPERTY + f"<xacro:{word}/>"), f"<xacro:{word}>") for word in ("include", "macro", "if", "arg", "leg")),
        (in_xacro(PROPERTY).replace("0.1 0 0.2", "${pi} 0 0.2"), "${pi}"),
        (in_xacro(PROPERTY).replace('lower="-2"', 'lower="$(arg low)"'), "$(arg"),
        (in_xacro(PROPERTY).replace('"link1"', '"${prefix}link1"'), "${prefix}link1"),
        (in_xacro(PROPERTY).replace('type="revolute"', 'type="${kind}"'), "${kind}"),
        (in_xacro("<xacro:leg/>", ""), "xacro:leg"),
    ],
)  # fmt: skip
def test_xacro_that_is_used_is_refused_and_named(text, words):
    with pytest.raises(InvalidInput, match="expand it first") as caught:
        Robot.from_urdf(text)
    assert caught.value.argument == "source" and words in caught.value.got


@pytest.mark.parametrize("encoding", ["gbk", "shift_jis", "latin-1", "cp1251"])
def test_text_that_is_not_utf_8_needs_its_encoding(tmp_path, encoding):
    word = {"gbk": "机器人", "shift_jis": "ロボット", "latin-1": "Größe", "cp1251": "робот"}[encoding]
    file, text = tmp_path / "arm.urdf", tree(2).replace("<link", f"\n<!-- {word} -->\n<link", 1)
    file.write_bytes(text.encode())
    assert Robot.from_urdf(file) == Robot.from_urdf(tree(2))
    file.write_bytes(text.encode(encoding))
    with pytest.raises(InvalidInput, match=r"bytes that are not UTF-8 in line 2, and no encoding is declared"):
        Robot.from_urdf(file)
    if encoding in ("latin-1", "cp1251"):  # expat reads encodings of one byte
        file.write_bytes(f'<?xml version="1.0" encoding="{encoding}"?>'.encode() + text.encode(encoding))
        assert Robot.from_urdf(file) == Robot.from_urdf(tree(2))


# ---------------------------------------------------------------- SRDF
def allowed_by_moveit(one, other, silent, enabled, disabled):
    """Whether MoveIt leaves out a pair of links: its matrix is filled by default, then enabled, then disabled."""
    if {one, other} in disabled:
        return True
    return {one, other} not in enabled and (one in silent or other in silent)


@pytest.mark.parametrize("seed", range(8))
def test_the_pairs_of_an_srdf_are_those_of_moveit(seed):
    rng = np.random.default_rng(seed)
    text = tree(5)
    for i in range(6):
        shape = f'<collision><origin xyz="{i} 0 0"/><geometry><sphere radius="0.01"/></geometry></collision>'
        text = text.replace(f'<link name="link{i}"/>', f'<link name="link{i}">{shape}</link>')
    robot = Robot.from_urdf(text, shapes=True)
    pairs = list(itertools.combinations([f"link{i}" for i in range(6)], 2))
    silent = [f"link{i}" for i in range(6) if rng.uniform() < 0.3]
    enabled, disabled = ([set(pair) for pair in pairs if rng.uniform() < 0.25] for _ in range(2))

    def pair(word, links):
        one, other = rng.permutation(sorted(links))
        return f'<{word} link1="{one}" link2="{other}" reason="so"/>'

    lines = [f'<disable_default_collisions link="{link}"/>' for link in silent]
    lines += [pair("enable_collisions", two) for two in enabled] + [pair("disable_collisions", two) for two in disabled]
    lines += ['<disable_default_collisions link="elsewhere"/>', '<enable_collisions link1="elsewhere" link2="link1"/>']
    shapes = robot.shapes.with_srdf(f"<robot>{''.join(rng.permutation(lines))}</robot>")
    checked = {frozenset((shapes.names[i], shapes.names[j])) for i, j in shapes.pairs}
    expected = {
        frozenset((one, other)) for one, other in pairs
        if abs(int(one[4:]) - int(other[4:])) > 1 and not allowed_by_moveit(one, other, silent, enabled, disabled)
    }  # fmt: skip
    assert checked == expected
    assert {reason for one, other, reason in shapes.left_out if {one, other} in disabled} <= {"neighbours", "so"}


@pytest.mark.parametrize("element", ["disable_default_collisions", "enable_collisions", "disable_collisions"])
def test_an_element_of_an_srdf_without_its_links_is_named(element):
    shapes = optik.load("panda").shapes
    with pytest.raises(InvalidInput, match=rf"^srdf: .*<{element}> without link"):
        shapes.with_srdf(f'<robot><{element} reason="x"/></robot>')
