"""Files that are there whole or not at all."""

import subprocess
import sys

import pytest

from optik.errors import OutputError
from optik.files import write_whole
from tests.oracles import REPOSITORY


def test_a_file_is_written_and_nothing_else_is_left(tmp_path):
    target = tmp_path / "run.json"
    write_whole(target, lambda path: path.write_text("one"))
    write_whole(str(target), lambda path: path.write_text("two"))
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
        write_whole(target, write)
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
            write_whole(target, lambda path: path.write_text("new"))
        assert caught.value.path == str(target)
    assert (folder / "file").read_text() == "kept"
    assert list(tmp_path.iterdir()) == [folder]


KILLED = """
import os, sys
from optik.files import write_whole
def write(path):
    path.write_text("half")
    os._exit(9)
write_whole(sys.argv[1], write)
"""


def test_a_process_that_dies_while_writing_leaves_the_old_file(tmp_path):
    target = tmp_path / "run.json"
    target.write_text("old")
    done = subprocess.run([sys.executable, "-c", KILLED, str(target)], cwd=REPOSITORY, check=False)
    assert done.returncode == 9
    assert target.read_text() == "old"
