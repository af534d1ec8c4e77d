"""Install the wheel of ``make wheel`` into a fresh environment and use it with nothing cached: ``python -m tests.wheel``.

Nothing may be compiled there, and every kernel in it must load. Not a test of pytest, because it installs packages.
"""

import os
import re
import subprocess
import sys
import venv
import zipfile
from pathlib import Path
from tempfile import TemporaryDirectory

ROOT = Path(__file__).resolve().parents[1]
LARGEST = 12e6
"""Bytes of the wheel."""

LOAD = """
import pickle
from numba.core.compiler import CompileResult
from numba.core.registry import cpu_target
from optik.compiled import archive
from optik.compiled.fingerprint import VERSIONS

context, shipped = cpu_target.target_context, archive.open_archive()
context.refresh()
assert not shipped.refusal(VERSIONS, archive.Target(*context.codegen().magic_tuple()))
for fingerprint, name in shipped.names.items():
    CompileResult._rebuild(context, *pickle.loads(shipped.read(fingerprint)))
print(f"{len(shipped.names)} kernels load")
"""


def main() -> None:
    """Build the environment, and run the example and the demo."""
    (wheel,) = (ROOT / "dist").glob("*.whl")
    assert wheel.stat().st_size <= LARGEST, f"{wheel}: {wheel.stat().st_size / 1e6:.1f} MB"
    assert [name for name in zipfile.ZipFile(wheel).namelist() if name.startswith("optik/compiled/_kernels/")]
    (lines,) = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(encoding="utf-8"), flags=re.S)
    with TemporaryDirectory() as folder:
        venv.create(Path(folder, "venv"), with_pip=True)
        python = str(Path(folder, "venv", "Scripts" if os.name == "nt" else "bin", "python"))
        environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
        environment |= {
            "PIP_CONSTRAINT": str(ROOT / "constraints.txt"),
            "OPTIK_COMPILES": "error",
            "NUMBA_CACHE_DIR": str(Path(folder, "cache")),
        }
        for words in (
            ["-m", "pip", "install", "--quiet", f"{wheel}[closed-form]"],
            ["-c", lines],
            ["-m", "benchmarks.cli", "demo", "--out", "demo"],
            ["-c", LOAD],
            ["-m", "benchmarks.cli", "kernels"],
        ):
            print("wheel:", *words[:3] if words[0] == "-m" else ["the README's lines" if words[1] == lines else "load"])
            subprocess.run([python, "-P", *words], cwd=folder, env=environment, check=True)
        assert not list(Path(folder).rglob("*.nbk")), "something was compiled"
    sys.stdout.flush()


if __name__ == "__main__":
    main()
