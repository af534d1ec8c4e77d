"""Common calls that compile the kernels, each part run in a process of its own, which prints each kernel."""

from __future__ import annotations

import os
import re
import runpy
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any

import numpy as np
from numba.core import event

import optik
import planners
from benchmarks.provenance import ROOT
from optik.compiled.kernel import Helper, Kernel

REST = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])
"""A configuration of panda [rad]."""


def ik() -> None:
    """Solve single targets and batches, poses and positions, for arms of six and seven joints."""
    for name in ("panda", "ur5e", "paper6r"):  # another process begins with paper6r
        robot = optik.load(name)
        q0 = robot.limits.clip(REST[: robot.n])
        target = robot.fk(robot.limits.clip(q0 + 0.2))
        optik.solve_ik(robot, target, q0)
        optik.solve_ik(robot, target, q0, task="position")
        optik.solve_ik(robot, target, q0, closest=True)
        for threads in (1, None):
            optik.solve_ik_batch(robot, np.array([target] * 40), q0, threads=threads)
        robot.singular_values(q0), robot.jacobian(np.array([q0, q0])), robot.fk(np.array([q0, q0]))


def lines() -> None:
    """Plan the README's line, stop on it, replan within other limits, and plan a polyline."""
    robot, q0 = optik.load("paper6r"), np.deg2rad([20, -35, 40, 25, 50, -30])
    start = robot.fk(q0)
    goal = optik.se3.pose(start[:3, :3], start[:3, 3] + [-0.12, 0.0, 0.20])
    optik.solve_ik(robot, goal, q0)
    plan = planners.plan(robot, planners.Line(start, goal), q0)
    bool(plan), plan.trajectory(0.1, 1), str(plan)
    planners.replan(plan, 0.15, stop=True)
    limits = planners.MotionLimits(2.0, 12.0, 120.0, tool_speed=0.3)
    planners.replan(plan, 0.15, limits=limits)
    corner = optik.se3.pose(start[:3, :3], start[:3, 3] + [-0.05, 0.0, 0.05])
    planners.plan(robot, planners.Polyline([start, corner, goal], blend=0.002), q0, limits=limits)


def panda() -> None:
    """Plan with torque limits, a payload and a scene, and search around an object."""
    robot = optik.load("panda")
    box = (optik.se3.pose(p=[0.6, 0.0, 0.1]), np.array([0.3, 0.6, 0.2]))
    scene = optik.Scene(margin=0.02, boxes=(box,), planes=((np.array([0.0, 0.0, -0.05]), np.array([0.0, 0.0, 1.0])),))
    optik.solve_ik(robot, robot.fk(REST), REST, scene=scene)
    planners.plan(robot, REST + np.array([0.5, 0.2, 0.0, 0.2, 0.0, 0.0, 0.0]), REST, scene=scene)
    planners.find_path(robot, REST, REST * [-1, 1, 1, 1, 1, 1, 1] + [1.0, 0, 0, 0, 0, 0, 0], scene=scene)
    loaded = robot.with_payload(3.0)
    loaded.torques(REST, 0 * REST, 0 * REST), loaded.gravity_torques(REST), loaded.mass_matrix(REST)
    start = robot.fk(REST)
    line = planners.Line(start, optik.se3.pose(start[:3, :3], start[:3, 3] + [0.0, 0.2, 0.1]))
    plan = planners.plan(loaded, line, REST)
    planners.replan(plan, 0.3 * plan.trajectory.duration, stop=True)


def choices() -> None:
    """Choose paths around an obstacle and with freedoms."""
    robot, limits = optik.load("panda"), planners.MotionLimits(2.0, 10.0, 100.0)
    wall = optik.Scene(margin=0.002, boxes=((optik.se3.pose(p=[0.5, 0.3, 0.35]), np.array([0.5, 0.02, 0.7])),))
    goal = np.array([1.2, 0.3, 0.1, -1.9, -0.1, 2.1, 0.9])
    planners.plan(robot, goal, REST, limits=limits, scene=wall, avoid=True)
    start = robot.fk(REST)
    line = planners.Line(start, optik.se3.pose(start[:3, :3], start[:3, 3] + [0.0, 0.2, 0.1]))
    planners.plan(robot.with_payload(1.0), planners.free(line, turn=True, tilt=0.2), REST, scene=optik.Scene())
    planners.plan(robot, planners.free(line, turn=1.0), limits=limits, timing="smooth")


def streams() -> None:
    """Lead a motion elsewhere: by chunks of joints and of poses."""
    robot, limits = optik.load("panda"), planners.MotionLimits(2.0, 10.0, 100.0)
    plan = planners.plan(robot, REST + 0.2, REST, limits=limits)
    waves = np.sin(np.arange(20)[:, None] * np.linspace(0.05, 0.1, 7))
    for targets in (REST + 0.3 * waves, robot.fk(REST + 0.3 * waves)):
        planners.retarget(plan, at=0.1, onto=planners.streams.Chunk(targets, rate=20.0, observed=0.05))


def cell() -> None:
    """Move to a laser spot, with corrections."""
    from planners.cell import Cell, PanTiltLaser

    robot, q0 = optik.load("paper6r"), np.deg2rad([20, -35, 40, 25, 50, -30])
    laser = PanTiltLaser(optik.se3.pose(p=[-0.6, 0.2, 0.1]), angle_noise=2e-4, range_noise=5e-4)
    work = Cell(robot, laser, "ideal", q=q0)
    work.move_to_spot(work.read(robot.fk(q0)[:3, 3] + [-0.12, 0.0, 0.20]), corrections=2)


def demo() -> None:
    """Run the demo in this process, with so few problems for each method that only compiling takes time."""
    from benchmarks.report import write_report
    from benchmarks.run import run_suite
    from benchmarks.suite import load_suite, suite_of

    settings = load_suite("paper").settings
    for block in (*settings["budgets"], *settings["calls"]):
        for method in block["methods"]:
            method["max_problems"] = 200
    with tempfile.TemporaryDirectory() as folder:
        run = run_suite(suite_of("paper", settings), Path(folder) / "run")
        write_report(run)


def chains() -> None:
    """Solve single targets and batches for arms of four to ten joints, because each number of joints has its own kernels."""
    for n in range(4, 11):
        limits = optik.JointLimits(np.full(n, -3.0), np.full(n, 3.0))
        robot, q0 = optik.Robot.from_mdh([optik.DHRow(a=0.1, alpha=1.0, d=0.1)] * n, limits), np.full(n, 0.5)
        target = robot.fk(q0 + 0.1)
        optik.solve_ik(robot, target, q0), optik.solve_ik_batch(robot, np.array([target] * 40), q0)


def pages() -> None:
    """Run the Python of the README, of the documentation and of the examples."""
    with tempfile.TemporaryDirectory() as folder:
        for place in ("examples", "examples/plugins"):  # the pages name files that lie beside them
            shutil.copytree(ROOT / place, folder, dirs_exist_ok=True)
        os.chdir(folder)
        sys.path.insert(0, folder)
        for page in [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]:
            code = []
            for block in re.findall(r"```(?:python|toml)\n(.*?)```", page.read_text(encoding="utf-8"), flags=re.S):
                if named := re.match(r"# (\w+\.(?:py|toml))\n", block):
                    (Path(folder) / named[1]).write_text(block, encoding="utf-8")
                else:
                    code.append(block)
            exec(compile("\n".join(code), str(page), "exec"), {"__name__": "__main__"})
        for example in sorted((ROOT / "examples").glob("*.py")):
            sys.argv = [str(example)]
            runpy.run_path(str(example), run_name="__main__")


WARM_UP: dict[str, Callable[[], None]] = {
    part.__name__: part for part in (lines, ik, panda, demo, choices, streams, cell)
}
"""The parts that an installed package can run, in the best order for two processes."""
COMPARED = ("demo",)
"""The parts that need the extra `bench`."""
SHIPPED: dict[str, Callable[[], None]] = WARM_UP | {"chains": chains, "pages": pages}
"""The parts whose kernels are shipped in the wheel."""

PROGRESS_SECONDS = 10.0
"""Interval between two lines of progress if the error stream is no terminal [s]."""


class Progress:
    """Counter of compiled kernels on the error stream: one line on a terminal, otherwise a line from time to time."""

    def __init__(self) -> None:
        self.count, self._begin = 0, time.monotonic()
        self._last = self._begin

    def __call__(self, kernel: str) -> None:
        """Count a kernel."""
        self.count += 1
        now, terminal = time.monotonic(), sys.stderr.isatty()
        if terminal or now - self._last > PROGRESS_SECONDS:
            words = f"compiled {self.count} kernels in {now - self._begin:.0f} s: {kernel}"
            print(
                f"\r\x1b[K{words[:70]}\r" if terminal else words,
                end="" if terminal else "\n",
                file=sys.stderr,
                flush=True,
            )
            self._last = now

    def end(self) -> str:
        """Clear the line, and return a summary."""
        print("\r\x1b[K" if sys.stderr.isatty() else "", end="", file=sys.stderr, flush=True)
        return f"{self.count} kernels in {time.monotonic() - self._begin:.0f} s"


def run_parts(parts: Sequence[str], jobs: int, say: Callable[[str], None], **environment: str) -> dict[str, str]:
    """Run the parts in so many processes, and `say` each compiled kernel; return the error of each part that failed."""
    path = os.pathsep.join([str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])])

    def run(part: str) -> str:
        command = [sys.executable, "-P", "-m", "benchmarks.kernels.parts", part]
        env = os.environ | {"PYTHONPATH": path} | environment
        with (
            TemporaryFile("w+") as errors,
            subprocess.Popen(command, stdout=subprocess.PIPE, stderr=errors, text=True, env=env) as process,
        ):
            for line in process.stdout or ():
                say(line.strip())
            if process.wait() == 0:
                return ""
            errors.seek(0)
            return (errors.read().strip().splitlines() or [f"exit status {process.returncode}"])[-1]

    with ThreadPoolExecutor(jobs) as pool:
        return {part: words for part, words in zip(parts, pool.map(run, parts), strict=True) if words}


class Teller(event.Listener):  # type: ignore[misc]
    """Event listener of Numba that prints the name of each compiled kernel."""

    def __init__(self, out: Any) -> None:
        self._out = out

    def on_start(self, event: Any) -> None:
        """Do nothing, because the name of the kernel is not known yet."""

    def on_end(self, event: Any) -> None:
        """Print the kernel's name."""
        kernel = event.data["dispatcher"]
        if isinstance(kernel, Kernel) and not isinstance(kernel, Helper):
            print(f"{kernel.py_func.__module__}.{kernel.py_func.__name__}", file=self._out, flush=True)


def main(part: str) -> None:
    """Run a part, and discard its output."""
    with os.fdopen(os.dup(1), "w") as out, open(os.devnull, "w") as nowhere:
        os.dup2(nowhere.fileno(), 1)
        with event.install_listener("numba:compile", Teller(out)):
            SHIPPED[part]()


if __name__ == "__main__":
    main(sys.argv[1])
