"""Files that are there whole or not at all."""

import pytest

from optik.errors import InvalidInput, OutputError
from optik.file_io import check_suffix, decode_text, parse_json, read_bytes, write_atomically
from tests import forks


def test_a_file_is_written_and_nothing_else_is_left(tmp_path):
    target = tmp_path / "run.json"
    write_atomically(target, lambda path: path.write_text("one"))
    write_atomically(str(target), lambda path: path.write_text("two"))
    assert target.read_text() == "two"
    assert list(tmp_path.iterdir()) == [target]


@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), RuntimeError("a bug"), KeyboardInterrupt()])
def test_a_write_that_ends_early_leaves_the_old_file_and_no_part(tmp_path, error):
    target = tmp_path / "run.json"
    target.write_text("old")

    def write(path):
        path.write_text("half")
        raise error

    with pytest.raises(OutputError if isinstance(error, OSError) else type(error)) as caught:
        write_atomically(target, write)
    assert target.read_text() == "old"
    assert list(tmp_path.iterdir()) == [target]
    if isinstance(error, OSError):
        assert str(target) in str(caught.value)
        assert "No space left" in str(caught.value)


def test_what_cannot_be_written_is_named(tmp_path):
    folder = tmp_path / "folder"
    folder.mkdir()
    (folder / "file").write_text("kept")
    for target in (folder, tmp_path / "nowhere" / "x", folder / "file" / "x", tmp_path / "nul\0byte"):
        with pytest.raises(OutputError) as caught:
            write_atomically(target, lambda path: path.write_text("new"))
        assert caught.value.path == str(target)
    assert (folder / "file").read_text() == "kept"
    assert list(tmp_path.iterdir()) == [folder]


KILLED = """
import os, sys
from optik.file_io import write_atomically
def write(path):
    path.write_text("half")
    os._exit(9)
write_atomically(sys.argv[1], write)
"""


def test_a_process_that_dies_while_writing_leaves_the_old_file(tmp_path):
    target = tmp_path / "run.json"
    target.write_text("old")
    assert forks.start(KILLED, str(target))().returncode == 9
    assert target.read_text() == "old"


# ---------------------------------------------------------------- reading
def test_a_file_is_read_up_to_a_size_and_no_further(tmp_path):
    file = tmp_path / "data"
    for size in (0, 5, 2**20 + 1):
        file.write_bytes(b"x" * size)
        assert read_bytes(file) == b"x" * size
        assert read_bytes(file, most=size) == b"x" * size
    with pytest.raises(InvalidInput, match="source: expected an arm; got more than 1 MB"):
        read_bytes(file, argument="source", expected="an arm", most=2**20)


@pytest.mark.parametrize("name", ["missing", "", "none/x", "nul\0byte"])
def test_what_cannot_be_read_is_named(name, tmp_path):
    with pytest.raises(InvalidInput) as caught:
        read_bytes(tmp_path / name)
    assert caught.value.argument == "file"
    assert repr(name)[1:-1] in str(caught.value)


@pytest.mark.parametrize("name", ["a.json", "b/A.JSON", "x.y.json"])
def test_a_suffix_is_read_in_lower_case(name):
    assert check_suffix(name, (".npz", ".json")) == ".json"


@pytest.mark.parametrize("name", ["a.jso", "json", ".json", "", 3, None, b"a.json"])
def test_another_suffix_is_refused(name):
    with pytest.raises(InvalidInput, match=r"\.npz, \.json"):
        check_suffix(name, (".npz", ".json"))


def test_text_is_utf_8():
    assert decode_text("q̇ ≤ 2".encode()) == "q̇ ≤ 2"
    with pytest.raises(InvalidInput, match="UTF-8"):
        decode_text(b"\xe9")


@pytest.mark.parametrize("text", ["", "{", "NaN", "[-Infinity]", "[" * 100_000, "1 2"])
def test_what_is_no_strict_json_is_refused(text):
    with pytest.raises(InvalidInput, match="header: expected JSON"):
        parse_json(text, "header")


def test_json_is_parsed():
    assert parse_json('{"a": [1, 2.5, null]}', "header") == {"a": [1, 2.5, None]}
