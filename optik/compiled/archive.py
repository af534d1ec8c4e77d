"""Archive of kernels compiled in advance: one file for a platform and a version of Python, in the package's own folder.

The first line contains the format, the length of the index and its SHA-256. The index (JSON) contains the versions and target
of the compiler, the name of each kernel, and the length and SHA-256 of each block: the code of a kernel, or a text of the LLVM
modules of all kernels of one source file. Only the compilation of a kernel's callers needs its module. Modules as bitcode would
take three times the space, because their texts have long parts in common. Kernels are found by their fingerprints, so outdated
code is never found. The file is not mapped into memory: if another process truncated a mapped file, this process would end.
"""

from __future__ import annotations

import hashlib
import json
import pickle
import platform
import re
import sys
import zlib
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

ARCHIVE_FORMAT = "optik kernels 2"
"""Format of an archive: the first words of the file."""
ARCHIVES = Path(__file__).parent / "_kernels"
"""Only folder from which archives are read, because their machine code is run."""
NEEDED = {
    "x86-64-v3": "avx avx2 bmi bmi2 cx16 f16c fma lzcnt movbe popcnt sahf sse3 sse4.1 sse4.2 ssse3 xsave",
    "generic": "",
    "apple-m1": "",
}
"""Features to check for each target processor, by LLVM's name; the platform implies the other features."""


class CompileTarget(NamedTuple):
    """Target of machine code: LLVM's triple, the name of the processor, and its features with the signs + and -."""

    triple: str
    cpu: str
    features: str


class Archive(NamedTuple):
    """Index of an archive: its target, the names of kernels, the places of their modules in texts, and those of blocks."""

    file: Path
    versions: tuple[str, ...]
    triple: str
    cpu: str
    names: Mapping[str, str]
    modules: Mapping[str, tuple[str, int, int]]
    places: Mapping[str, tuple[int, int, str]]

    def refusal(self, versions: Sequence[str], target: CompileTarget) -> str:
        """Return why this process cannot run the kernels, or an empty string."""
        differ = [
            f"{there}, here {here}" for there, here in zip(self.versions, versions, strict=False) if here != there
        ]
        if differ or len(self.versions) != len(versions):
            return f"compiled with {'; '.join(differ) or 'other versions'}"
        if _system(self.triple) != _system(target.triple):
            return f"compiled for {self.triple}, here {target.triple}"
        lacking = list_features(self.cpu) - {f[1:] for f in target.features.split(",") if f.startswith("+")}
        return f"compiled for {self.cpu}: this processor lacks {', '.join(sorted(lacking))}" if lacking else ""

    def read(self, fingerprint: str) -> tuple[bytes, Callable[[], Any]] | None:
        """Return a kernel's code, and what parses its LLVM module; None if the archive lacks it, an error if it is damaged."""
        if fingerprint not in self.names:
            return None
        from lzma import decompress

        from llvmlite.binding import parse_assembly  # which the build of the wheel lacks

        source, begin, end = self.modules[fingerprint]
        code, text = self._block(fingerprint), self._block(source)
        return zlib.decompress(code), lambda: parse_assembly(decompress(text)[begin:end].decode())

    def _block(self, key: str) -> bytes:
        """Return a block; ValueError if it is damaged."""
        begin, size, checksum = self.places[key]
        with self.file.open("rb") as file:
            file.seek(begin)
            data = file.read(size)
        if hashlib.sha256(data).hexdigest() != checksum:
            raise ValueError(key)
        return data


def list_features(cpu: str) -> set[str]:
    """Return the features that code for a processor needs; for an unknown one, a feature that no processor has."""
    return set(NEEDED.get(cpu, f"all-of-{cpu}").split())


def file_name() -> str:
    """Return the file name of the archive for this platform and version of Python."""
    python = f"{sys.implementation.cache_tag}{getattr(sys, 'abiflags', '')}"
    return f"{sys.platform}-{platform.machine().lower()}-{python}.kernels"


@cache
def open_archive() -> Archive | str:
    """Return the archive for this platform and version of Python, or the reason why there is none."""
    return load_archive(ARCHIVES / file_name())


def load_archive(file: Path) -> Archive | str:
    """Read the index of an archive; return a sentence if the file is missing or damaged."""
    try:
        with file.open("rb") as lines:
            words = lines.readline(200).decode().rstrip("\n").rsplit(" ", 2)
            size = int(words[1])
            text = lines.read(size)
            if words[0] != ARCHIVE_FORMAT or len(text) != size or hashlib.sha256(text).hexdigest() != words[2]:
                return f"{file} is damaged"
            index, begin = json.loads(text), lines.tell()
        if find_spec("_lzma") is None:
            return "this Python was built without lzma"
        names = {fingerprint: name for fingerprint, (name, *_) in index["kernels"].items()}
        modules = {fingerprint: tuple(module) for fingerprint, (_, *module) in index["kernels"].items()}
        places = {}
        for key, (length, checksum) in index["blocks"].items():
            places[key] = (begin, length, checksum)
            begin += length
        return Archive(file, tuple(index["versions"]), index["triple"], index["cpu"], names, modules, places)
    except FileNotFoundError:
        return f"there is no {file.name} in {file.parent}"
    except (OSError, ValueError, LookupError, TypeError, AttributeError) as error:
        return f"{file} is damaged: {type(error).__name__}"


def pack_archive(
    file: Path, versions: Sequence[str], target: CompileTarget, kernels: Mapping[str, tuple[str, bytes]]
) -> None:
    """Write an archive of kernels, given their names and what is cached of them by fingerprint."""
    from lzma import compress

    from llvmlite.binding import parse_bitcode

    blocks, index = {}, {}
    texts: defaultdict[str, bytes] = defaultdict(bytes)
    for fingerprint, (name, payload) in sorted(kernels.items()):
        code, bitcode = pickle.loads(payload)
        blocks[fingerprint] = zlib.compress(code, 9)
        source = name.partition(".")[0]
        begin, texts[source] = len(texts[source]), texts[source] + str(parse_bitcode(bitcode)).encode()
        index[fingerprint] = (name, source, begin, len(texts[source]))
    blocks |= {source: compress(text) for source, text in texts.items()}
    about: dict[str, Any] = {"versions": list(versions), "triple": target.triple, "cpu": target.cpu, "kernels": index}
    about["blocks"] = {key: (len(data), hashlib.sha256(data).hexdigest()) for key, data in blocks.items()}
    head = json.dumps(about).encode()
    file.parent.mkdir(parents=True, exist_ok=True)
    part = file.with_suffix(".part")
    part.write_bytes(
        f"{ARCHIVE_FORMAT} {len(head)} {hashlib.sha256(head).hexdigest()}\n".encode()
        + b"".join([head, *blocks.values()])
    )
    part.replace(file)


def _system(triple: str) -> str:
    """Return a triple without the version of the system, which macOS appends."""
    return re.sub(r"[\d.]+$", "", triple)
