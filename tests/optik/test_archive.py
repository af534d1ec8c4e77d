"""Kernels that are compiled in advance are used where they fit, and whatever is wrong with a file, the kernel is compiled."""

import json
import os
import pickle
import zlib
from pathlib import Path

import llvmlite.binding as llvm
import pytest
from numba.core.registry import cpu_target

from optik.compiled import archive, compiled
from optik.compiled.cache import VERSIONS, read_code
from tests import forks
from tests.optik.test_compile import INNER, REPOSITORY, write_two

HERE = archive.CompileTarget(*cpu_target.target_context.codegen().magic_tuple())
EMPTY = llvm.parse_assembly("").as_bitcode()
RUN = """
import json, sys
from pathlib import Path
from numba.core import event
from optik.compiled import archive
archive.ARCHIVES = Path(sys.argv[1])
compilations = event.RecordingListener()
event.register("numba:compile", compilations)
if sys.argv[2:]:
    from inner import inner
    inner(1.0)
from outer import outer
print(json.dumps([outer(1.0), sum(e.is_start for _, e in compilations.buffer)]))
"""


def forget_processor():
    """Before Numba asks a process for its processor, which it does once."""
    vars(cpu_target).pop("_toplevel_target_context")


def run(folder, *first, **env):
    """What `outer` computes in a fresh process with nothing cached, and how many functions are compiled for it."""
    kept = {k: v for k, v in os.environ.items() if k != "OPTIK_COMPILES"}
    places = {"PYTHONPATH": os.pathsep.join([str(REPOSITORY), str(folder)]), "NUMBA_CACHE_DIR": str(folder / "none")}
    for file in (folder / "none").rglob("*.nbk"):
        file.unlink()
    done = forks.start(RUN, str(folder), *first, cwd=folder, env=kept | places | env, before=forget_processor)()
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def packed(folder, **changes):
    """Pack what is in the cache of `run` for the processor with the least features."""
    kernels = {
        fingerprint: (f"two.{file.name}", code)
        for file in (folder / "none").rglob("*.nbk")
        for fingerprint, code in read_code(file).items()
    }
    about = {"versions": VERSIONS, "target": HERE._replace(cpu="x86-64-v3")} | changes
    archive.pack_archive(folder / archive.file_name(), about["versions"], about["target"], kernels)
    return kernels


@pytest.fixture(name="folder", scope="module")
def _folder(tmp_path_factory):
    """A folder with two kernels, one of which calls the other, and their archive."""
    folder = tmp_path_factory.mktemp("two")
    write_two(folder)
    assert run(folder) == [3.0, 2]
    assert len(packed(folder)) == 2
    shipped = archive.load_archive(folder / archive.file_name())
    for print_, name in shipped.names.items():
        assert any(name.split(".")[1] in f.name for f in shipped.read(print_)[1]().functions if not f.is_declaration)
    return folder


v3 = pytest.mark.skipif(
    not archive.list_features("x86-64-v3") <= {f[1:] for f in HERE.features.split(",") if f[0] == "+"},
    reason="this processor is not of x86-64-v3",
)


@v3
def test_what_is_shipped_is_not_compiled_and_a_change_compiles_what_depends_on_it(folder):
    assert run(folder, OPTIK_COMPILES="error") == [3.0, 0]
    assert run(folder, "inner", OPTIK_COMPILES="error") == [3.0, 0]  # which was compiled inside the other
    assert not list((folder / "none").rglob("*.nbk"))
    assert run(folder, OPTIK_COMPILES="native") == [3.0, 2]
    inner = folder / "inner.py"
    inner.write_text('"""Another docstring."""\n' + INNER.format("2.0"))
    assert run(folder) == [3.0, 0]
    outer = (folder / "outer.py").read_text()
    (folder / "outer.py").write_text(outer.replace("1.0", "2.0"))
    for first in ([], ["inner"]):  # code that is in use is compiled into callers, too
        assert run(folder, *first) == [4.0, 1]
        ((_, bitcode),) = (pickle.loads(*read_code(f).values()) for f in (folder / "none").rglob("outer*.nbk"))
        assert not [f.name for f in llvm.parse_bitcode(bitcode).functions if f.is_declaration and "inner" in f.name]
    (folder / "outer.py").write_text(outer)
    inner.write_text(INNER.format("5.0"))
    assert run(folder) == [6.0, 2]
    inner.write_text(INNER.format("2.0"))


@v3
def test_a_processor_that_lacks_a_feature_compiles(folder):
    less = ",".join("-avx2" if f == "+avx2" else f for f in HERE.features.split(","))
    assert run(folder, NUMBA_CPU_NAME="nehalem", NUMBA_CPU_FEATURES=less) == [3.0, 2]


def test_an_error_where_nothing_may_be_compiled(tmp_path):
    write_two(tmp_path)
    with pytest.raises(AssertionError, match=r"OPTIK_COMPILES=error.*outer"):
        run(tmp_path, OPTIK_COMPILES="error")


# ---------------------------------------------------------------- in this process
def third(x):
    return 3.0 * x


@pytest.fixture(name="shipped")
def _shipped(tmp_path, monkeypatch):
    """Counts the compilations of a call; the archive in the folder has the kernel."""
    monkeypatch.setattr("numba.core.config.CACHE_DIR", str(tmp_path / "none"))
    monkeypatch.setattr(archive, "ARCHIVES", tmp_path)
    monkeypatch.setattr(archive, "NEEDED", archive.NEEDED | {"any": ""})
    compiled(third)(1.0)
    packed(tmp_path, target=HERE._replace(cpu="any"))

    def call():
        for file in (tmp_path / "none").rglob("*.nbk"):
            file.unlink()
        archive.open_archive.cache_clear()
        kernel = compiled(third)
        assert kernel(1.0) == 3.0
        return kernel.stats.cache_misses.total()

    yield call
    archive.open_archive.cache_clear()


def test_a_damaged_file_is_as_none(shipped, tmp_path):
    file = tmp_path / archive.file_name()
    whole = file.read_bytes()
    assert shipped() == 0
    begin = whole.index(b"\n") + 1 + int(whole.split()[3])
    for cut in (0, 5, 60, 200, begin - 1, begin, begin + 10, len(whole) - 1):
        file.write_bytes(whole[:cut])
        assert shipped() == 1, cut
    for place in (*range(0, 100, 7), 200, begin - 2, begin, begin + 40, len(whole) - 3):
        file.write_bytes(whole[:place] + bytes([whole[place] ^ 0x11]) + whole[place + 1 :])
        assert shipped() == 1, place
    file.unlink()
    assert shipped() == 1
    file.mkdir()
    assert shipped() == 1
    file.rmdir()
    file.write_bytes(whole)
    assert shipped() == 0


def test_a_python_without_lzma_compiles(shipped, monkeypatch):
    monkeypatch.setattr(archive, "find_spec", lambda name: None)
    assert shipped() == 1


@pytest.mark.parametrize("code", [b"", b"no pickle", b"\x80\x04N.", b"cos\nsystem\n(S'exit'\n", b"\x80\x04)."])
def test_code_that_cannot_be_loaded_is_compiled(shipped, tmp_path, code):
    file, payload = tmp_path / archive.file_name(), pickle.dumps((code, EMPTY))
    kernels = {print_: (name, payload) for print_, name in archive.load_archive(file).names.items()}
    archive.pack_archive(file, VERSIONS, HERE._replace(cpu="any"), kernels)
    assert shipped() == 1


@pytest.mark.parametrize("index", [b"", b"[]", b"{}", b'{"kernels": 3}', b'{"kernels": {"a": [1]}}', b"\xff", b"null"])
def test_an_index_of_another_form_is_as_none(shipped, tmp_path, index):
    from hashlib import sha256

    file = tmp_path / archive.file_name()
    file.write_bytes(f"{archive.ARCHIVE_FORMAT} {len(index)} {sha256(index).hexdigest()}\n".encode() + index)
    assert shipped() == 1


@pytest.mark.parametrize("k", range(len(VERSIONS)))
def test_other_software_compiles_and_says_which(shipped, tmp_path, k):
    versions = [*VERSIONS[:k], "another 1", *VERSIONS[k + 1 :]]
    packed(tmp_path, versions=versions, target=HERE._replace(cpu="any"))
    assert shipped() == 1
    assert VERSIONS[k] in archive.open_archive().refusal(VERSIONS, HERE)


@pytest.mark.parametrize("change", [{"cpu": "a later one"}, {"triple": "riscv64-unknown-linux-gnu"}])
def test_another_processor_compiles(shipped, tmp_path, change):
    packed(tmp_path, target=HERE._replace(cpu="any")._replace(**change))
    assert shipped() == 1
    assert "compiled for" in archive.open_archive().refusal(VERSIONS, HERE)


def test_a_version_of_the_system_does_not_count():
    mine = archive.Archive(Path(), VERSIONS, "arm64-apple-darwin23.1.0", "apple-m1", {}, {}, {})
    assert not mine.refusal(VERSIONS, archive.CompileTarget("arm64-apple-darwin24.0.0", "apple-m2", ""))


def test_archives_are_read_from_the_package_only():
    assert Path(archive.__file__).resolve().parent / "_kernels" == archive.ARCHIVES.resolve()
    assert zlib.ZLIB_VERSION
