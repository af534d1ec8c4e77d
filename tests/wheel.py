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
from numba.core.registry import cpu_target
from optik.compiled import archive
from optik.compiled.cache import rebuild
from optik.compiled.cache import VERSIONS

context, shipped = cpu_target.target_context, archive.open_archive()
context.refresh()
assert not shipped.refusal(VERSIONS, archive.CompileTarget(*context.codegen().magic_tuple()))
for fingerprint, name in shipped.names.items():
    kernel = rebuild(context, *shipped.read(fingerprint))
    assert kernel.fndesc.llvm_func_name in [f.name for f in kernel.library._get_module_for_linking().functions]
print(f"{len(shipped.names)} kernels load")
"""

ARMS = """
import numpy as np, optik, planners

for n in range(4, 11):
    limits = optik.JointLimits(np.full(n, -2.9), np.full(n, 2.9), velocity=2.0, acceleration=10.0, jerk=100.0)
    robot = optik.Robot.from_dh([optik.DHRow(0.05, 1.2, 0.15)] * n, limits)
    q0 = np.linspace(0.3, 0.9, n) * (-1) ** np.arange(n)
    start, target = robot.fk(q0), robot.fk(q0 + 0.1)
    assert optik.solve_ik(robot, target, q0) and optik.solve_ik_batch(robot, np.array([target] * 40), q0).solved.all()
    assert planners.plan(robot, q0 + 0.3, q0)
    goal = optik.se3.pose(start[:3, :3], start[:3, 3] + 0.02)
    assert planners.plan(robot, planners.Line(start, goal), q0) or n < 6
"""


def main() -> None:
    """Build the environment, and run the example and the demo."""
    (wheel,) = (ROOT / "dist").glob("*.whl")
    assert wheel.stat().st_size <= LARGEST, f"{wheel}: {wheel.stat().st_size / 1e6:.1f} MB"
    assert [name for name in zipfile.ZipFile(wheel).namelist() if name.startswith("optik/compiled/_kernels/")]
    (lines,) = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(encoding="utf-8"), flags=re.S)
    names = {lines: "the README's lines", LOAD: "load", ARMS: "arms of four to ten joints"}
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
            ["-m", "pip", "install", "--quiet", str(wheel)],
            ["-c", lines],
            ["-m", "pip", "install", "--quiet", f"{wheel}[bench,closed-form]"],
            ["-m", "benchmarks.cli", "demo", "--out", "demo"],
            ["-c", LOAD],
            ["-c", ARMS],
            ["-m", "benchmarks.cli", "kernels"],
        ):
            print("wheel:", *words[:3] if words[0] == "-m" else [names[words[1]]])
            subprocess.run([python, "-P", *words], cwd=folder, env=environment, check=True)
        assert not list(Path(folder).rglob("*.nbk")), "something was compiled"
    sys.stdout.flush()


if __name__ == "__main__":
    main()
