"""Archive of kernels compiled in advance: one file for a platform and a version of Python, in the package's own folder.

The first line contains the format, the length of the index and its SHA-256. The index (JSON) contains the versions and target
of the compiler, and the name, length and SHA-256 of each kernel. Kernels are found by their fingerprints, so outdated code is
never found. The file is not mapped into memory: if another process truncated a mapped file, this process would end.
"""

from __future__ import annotations

import hashlib
import json
import lzma
import platform
import re
import sys
import zlib
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

ARCHIVE_FORMAT = "optik kernels 2"
"""Format of an archive: the first words of the file."""
SMALL_BLOCKS = 6
"""zlib's memLevel: shorter blocks fit machine code better; the default of 8 makes the archive 0.5 % larger."""
LARGE = 30_000
"""Size [bytes] above which a kernel is compressed by LZMA: 12 % smaller, and 20 to 30 ms for each megabyte to read."""
XZ = b"\xfd7zXZ\x00"
"""First bytes of LZMA's format."""
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
    """Index of an archive: its target, and the position, size and SHA-256 of the code of each kernel."""

    file: Path
    versions: tuple[str, ...]
    triple: str
    cpu: str
    names: Mapping[str, str]
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

    def read(self, fingerprint: str) -> bytes | None:
        """Return the code of a kernel; None if the archive lacks it or is damaged."""
        if fingerprint not in self.places:
            return None
        begin, size, checksum = self.places[fingerprint]
        try:
            with self.file.open("rb") as file:
                file.seek(begin)
                packed = file.read(size)
            code = lzma.decompress(packed) if packed.startswith(XZ) else zlib.decompress(packed)
        except (OSError, zlib.error, lzma.LZMAError):
            return None
        return code if hashlib.sha256(code).hexdigest() == checksum else None


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
    return load(ARCHIVES / file_name())


def load(file: Path) -> Archive | str:
    """Read the index of an archive; return a sentence if the file is missing or damaged."""
    try:
        with file.open("rb") as lines:
            words = lines.readline(200).decode().rstrip("\n").rsplit(" ", 2)
            size = int(words[1])
            text = lines.read(size)
            if words[0] != ARCHIVE_FORMAT or len(text) != size or hashlib.sha256(text).hexdigest() != words[2]:
                return f"{file} is damaged"
            index, begin = json.loads(text), lines.tell()
        names, places = {}, {}
        for fingerprint, (name, length, checksum) in index["kernels"].items():
            names[fingerprint], places[fingerprint] = name, (begin, length, checksum)
            begin += length
        return Archive(file, tuple(index["versions"]), index["triple"], index["cpu"], names, places)
    except FileNotFoundError:
        return f"there is no {file.name} in {file.parent}"
    except (OSError, ValueError, LookupError, TypeError, AttributeError) as error:
        return f"{file} is damaged: {type(error).__name__}"


def pack(file: Path, versions: Sequence[str], target: CompileTarget, kernels: Mapping[str, tuple[str, bytes]]) -> None:
    """Write an archive of kernels, given their names and codes by fingerprint."""
    codes, index = [], {}
    for fingerprint, (name, code) in sorted(kernels.items()):
        if len(code) > LARGE:
            codes.append(lzma.compress(code, preset=9))
        else:
            deflate = zlib.compressobj(9, zlib.DEFLATED, zlib.MAX_WBITS, SMALL_BLOCKS)
            codes.append(deflate.compress(code) + deflate.flush())
        index[fingerprint] = [name, len(codes[-1]), hashlib.sha256(code).hexdigest()]
    about: dict[str, Any] = {"versions": list(versions), "triple": target.triple, "cpu": target.cpu, "kernels": index}
    text = json.dumps(about).encode()
    file.parent.mkdir(parents=True, exist_ok=True)
    part = file.with_suffix(".part")
    part.write_bytes(
        f"{ARCHIVE_FORMAT} {len(text)} {hashlib.sha256(text).hexdigest()}\n".encode() + text + b"".join(codes)
    )
    part.replace(file)


def _system(triple: str) -> str:
    """Return a triple without the version of the system, which macOS appends."""
    return re.sub(r"[\d.]+$", "", triple)
