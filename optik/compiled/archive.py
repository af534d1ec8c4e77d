"""Kernels compiled in advance: one file for a platform and a Python, in the package's own folder and read from there only.

The first line holds the format, the length of the index and its SHA-256. The index, in JSON, holds the versions and the target
of the compiler, and the name, length and SHA-256 of each kernel. A kernel is found by its fingerprint, so code that is outdated
is never found. The file is not mapped into memory: a mapped file that another process truncates would end this process.
"""

from __future__ import annotations

import hashlib
import json
import platform
import re
import sys
import zlib
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

ARCHIVE_FORMAT = "optik kernels 1"
"""First words of an archive."""

ARCHIVES = Path(__file__).parent / "_kernels"
"""The only folder that archives are read from: the machine code in them is run."""

NEEDED = {
    "x86-64-v3": "avx avx2 bmi bmi2 cx16 f16c fma lzcnt movbe popcnt sahf sse3 sse4.1 sse4.2 ssse3 xsave",
    "generic": "",
    "apple-m1": "",
}
"""LLVM's names of the processors that archives are compiled for, and the features to check; the platform implies the others."""


class Target(NamedTuple):
    """What machine code is compiled for: LLVM's triple, the name of the processor, and its features, each after + or -."""

    triple: str
    cpu: str
    features: str


class Archive(NamedTuple):
    """An archive that was opened: what it was compiled for, and the place, size and SHA-256 of each kernel's code."""

    file: Path
    versions: tuple[str, ...]
    triple: str
    cpu: str
    names: Mapping[str, str]
    places: Mapping[str, tuple[int, int, str]]

    def refusal(self, versions: Sequence[str], target: Target) -> str:
        """Why this process cannot run these kernels, or nothing."""
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
        """Return a kernel's code; None if the archive lacks it, or if the file is damaged."""
        if fingerprint not in self.places:
            return None
        begin, size, checksum = self.places[fingerprint]
        try:
            with self.file.open("rb") as file:
                file.seek(begin)
                code = zlib.decompress(file.read(size))
        except (OSError, zlib.error):
            return None
        return code if hashlib.sha256(code).hexdigest() == checksum else None


def list_features(cpu: str) -> set[str]:
    """Return the features that the code for a processor needs; for an unknown one, a feature that no processor has."""
    return set(NEEDED.get(cpu, f"all-of-{cpu}").split())


def file_name() -> str:
    """Name of the archive for this platform and Python."""
    python = f"{sys.implementation.cache_tag}{getattr(sys, 'abiflags', '')}"
    return f"{sys.platform}-{platform.machine().lower()}-{python}.kernels"


@cache
def open_archive() -> Archive | str:
    """Return the archive for this platform and Python, or why there is none."""
    return load(ARCHIVES / file_name())


def load(file: Path) -> Archive | str:
    """Read the index of an archive; a file that is damaged, or another, is described by a sentence."""
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


def pack(file: Path, versions: Sequence[str], target: Target, kernels: Mapping[str, tuple[str, bytes]]) -> None:
    """Write an archive of kernels: by fingerprint, the name and the code of each."""
    codes, index = [], {}
    for fingerprint, (name, code) in sorted(kernels.items()):
        codes.append(zlib.compress(code, 9))
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
    """A triple without the version of the system, which macOS names there."""
    return re.sub(r"[\d.]+$", "", triple)
