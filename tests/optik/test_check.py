"""What people pass: numbers, counts and arrays, refused by name."""

import inspect
import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

import optik
import planners
from optik import se3
from optik.check import check_count, check_flag, check_keywords, check_number, check_words, real_array
from optik.errors import InvalidInput, OptikError, UnknownName

ARM = optik.load("paper6r")


@given(arrays(st.sampled_from(["f8", "f4", "i4", "u1", ">f8"]), array_shapes(min_dims=0, max_dims=4)))
def test_an_array_of_numbers_is_itself_as_float64_in_c_order(value):
    for form in (value, value.tolist(), np.asfortranarray(value), value.T):
        got = real_array(form, "x", "numbers")
        assert got.dtype == np.float64
        assert got.flags.c_contiguous
        assert got.shape == np.shape(form)
        np.testing.assert_array_equal(got, np.array(form, dtype=float))


START = np.zeros(6)
MISSPELLED = {
    "a law's option": (
        lambda: planners.plan(ARM, ARM.fk(START), START, speed=0.1),
        'make_law("constant_speed", speed=0.1)',
    ),
    "a limit": (lambda: planners.plan(ARM, ARM.fk(START), START, jerk=5.0), "MotionLimits.of(robot, velocity="),
    "its type": (lambda: planners.plan(ARM, ARM.fk(START), START, law="optimal"), "did you mean timing?"),
    "angles": (lambda: se3.pose(rpy=[0, 0, 1]), "from_xyz_rpy(xyz, rpy_deg)"),
    "a field": (lambda: planners.MotionLimits(acc=3), "did you mean acceleration?"),
    "an object": (lambda: optik.Scene(boxs=[]), "did you mean boxes"),
    "a path": (lambda: planners.Line(strat=1), "did you mean start"),
    "a file": (lambda: optik.load("ur5e", tipp="x"), "did you mean tip?"),
    "a method": (lambda: ARM.with_tool(tol=np.eye(4)), "did you mean tool"),
    "a loader": (lambda: optik.Scene.load("x.yaml", robt=ARM), "did you mean robot?"),
}


@pytest.mark.parametrize("name", MISSPELLED)
def test_a_keyword_that_does_not_exist_is_answered_in_a_short_line(name):
    call, wanted = MISSPELLED[name]
    with pytest.raises(UnknownName) as caught:
        call()
    assert wanted in str(caught.value) and len(str(caught.value)) <= 200 and "\n" not in str(caught.value)


def test_checked_functions_keep_their_names_signatures_and_pickles():
    assert list(inspect.signature(planners.plan).parameters)[:3] == ["robot", "path", "q_start"]
    assert pickle.loads(pickle.dumps(planners.plan)) is planners.plan and planners.plan.__name__ == "plan"
    assert inspect.signature(optik.Scene).parameters["margin"].default == 0.0

    @check_keywords
    def takes_all(x, **more):
        return x, more

    assert takes_all(1, y=2) == (1, {"y": 2})


def test_the_options_of_a_law_are_listed():
    with pytest.raises(InvalidInput, match=r"'constant_speed': speed, ramp; got velocity"):
        planners.make_law("constant_speed", velocity=0.1)


BAD_ARRAYS = {
    "a word": "abc", "words": ["1", "2"], "bytes": b"12", "complex": [1j, 2.0],
    "complex without imaginary parts": np.ones(3, dtype=complex), "ragged": [[1], [1, 2]], "None": None,
    "Nones": [None, 1.0], "a dict": {"a": 1}, "a set": {1.0}, "truths": [True, False],
    "dates": np.array(["2020-01-01"], dtype="datetime64[D]"), "objects": np.array([1.0, "a"], dtype=object),
}  # fmt: skip


@pytest.mark.parametrize("value", BAD_ARRAYS.values(), ids=BAD_ARRAYS.keys())
def test_what_is_no_array_of_real_numbers_is_refused_by_name(value):
    with pytest.raises(InvalidInput, match=r"^lengths: expected three numbers; got ") as caught:
        real_array(value, "lengths", "three numbers")
    assert caught.value.argument == "lengths"


@pytest.mark.parametrize(("shape", "good"), [((3,), True), ((..., 3), True), ((...,), True), ((), False), ((1, 3), False),
                                             ((..., 1, 3), False), ((2,), False), ((..., 4), False)])  # fmt: skip
def test_a_shape_is_that_of_all_or_the_last_axes(shape, good):
    if good:
        assert real_array([1, 2, 3], "x", "numbers", shape).shape == (3,)
        return
    with pytest.raises(InvalidInput, match=r"^x: expected numbers; got shape \(3,\)"):
        real_array([1, 2, 3], "x", "numbers", shape)


CALLS = {
    "pose of R": se3.pose, "pose of p": lambda x: se3.pose(None, x), "exp_so3": se3.exp_so3,
    "error": lambda x: se3.error(np.eye(4), x), "from_quaternion": se3.from_quaternion, "load": optik.load,
    "clip": optik.load("ur5e").limits.clip, "contains": optik.load("ur5e").limits.contains, "without": optik.Scene().without,
}  # fmt: skip


@pytest.mark.parametrize("name", CALLS)
def test_misuse_is_an_error_of_ours(name):
    for value in [*BAD_ARRAYS.values(), 10**400, [], [1, 2], np.zeros((2, 2)), np.ma.array([1, 2])]:
        if name != "pose of R" or value is not None:  # the identity
            with pytest.raises(OptikError):
                CALLS[name](value)


@pytest.mark.parametrize("value", [1, 1.5, np.float32(2.5), np.int8(3), np.float64(4.0)])
def test_a_number_is_itself(value):
    got = check_number(value, "x", "a number")
    assert type(got) is float
    assert got == value


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, True, "1", None, 1j, [1.0], np.ones(1), np.ones(2)])
def test_what_is_no_finite_number_is_refused_by_name(value):
    with pytest.raises(InvalidInput, match=r"^x: expected a number; got "):
        check_number(value, "x", "a number")


def test_bounds_are_kept_to_the_last_digit():
    assert check_number(0.0, "x", "≥ 0", least=0.0) == 0.0
    assert check_number(5e-324, "x", "above 0", above=0.0) > 0.0
    for bounds, value in (({"least": 0.0}, -5e-324), ({"above": 0.0}, 0.0), ({"above": 0.0}, -1)):
        with pytest.raises(InvalidInput):
            check_number(value, "x", "more", **bounds)


def test_a_count_is_a_whole_number_of_at_least_so_many():
    for value in (0, 3, np.int64(3), np.uint8(3), 10**30):
        check_count(value, "k", 0)
    for value in (-1, True, False, 3.0, np.float64(3), "3", None, [3], np.nan):
        with pytest.raises(InvalidInput, match=r"^k: expected a whole number ≥ 0; got "):
            check_count(value, "k", 0)
    with pytest.raises(InvalidInput):
        check_count(1, "k", 2)


@pytest.mark.parametrize("value", [True, False, np.True_, np.False_, 1, 0, np.int8(1)])
def test_a_yes_or_no_is_itself(value):
    assert check_flag(value, "slow") is bool(value)


@pytest.mark.parametrize("value", ["no", "", "True", None, np.nan, 1.0, 2, -1, [], [False], np.array([True]), object()])
def test_what_is_no_yes_or_no_is_refused_by_name(value):
    with pytest.raises(InvalidInput, match=r"^slow: expected True or False; got "):
        check_flag(value, "slow")


@pytest.mark.parametrize("value", [10**9 + 1, 10**30, np.int64(2**62)])
def test_a_count_beyond_the_most_is_refused_by_name(value):
    check_count(10**9, "tries", 0, 10**9)
    with pytest.raises(InvalidInput, match=r"^tries: expected a whole number from 0 to 1,000,000,000; got "):
        check_count(value, "tries", 0, 10**9)


@pytest.mark.parametrize("value", ["abc", b"abc", 3, None, [1, 2], ["a", 2]])
def test_what_are_no_words_are_refused_by_name(value):
    assert check_words(["a", "b"], "names") == check_words((x for x in "ab"), "names") == ("a", "b")
    with pytest.raises(InvalidInput, match=r"^names: expected "):
        check_words(value, "names")
