"""A notebook in a real kernel: an arm from a URDF, IK, plans, plots, pages, own methods, and the motion of another program."""

from typing import Any

import nbformat
import pytest
from nbclient import NotebookClient

from tests.oracles import REPOSITORY

MOST_TEXT = 2000
"""Characters of text in an output, besides figures."""
FIGURES = ("text/html", "image/png", "image/svg+xml", "application/vnd.plotly.v1+json")
"""Forms of an output that a notebook shows instead of its text."""

SOLVER = '''
import numpy as np
from optik.ik.base import Attempt, IKSolver, IKStatus

class {name}(IKSolver):
    """Newton's iteration with the pseudo-inverse."""
    takes_tasks = False

    def attempt(self, target, start, trace, time_limit):
        q = start.copy()
        for k in range(self.max_iterations + 1):
            e = self.robot.pose_errors(q, target)
            if np.abs(e).max() <= 0.5 * min(self.tolerance):
                return Attempt(q, IKStatus.SOLVED, k, None)
            q = self.robot.limits.clip(q + {gain} * np.linalg.pinv(self.robot.jacobian(q)) @ e)
        return Attempt(q, IKStatus.MAX_ITERATIONS, k, None)
'''
CSV = """t,joint1,joint2,joint3,joint4,joint5,joint6
0,0,0.5,0.6,0,0.8,0
1,0.4,0.5,0.6,0,0.8,0
2,0.4,0.5,0.6,0,0.8,0
"""

CELLS: list[tuple[str, str]] = [
    ("import numpy as np, optik, planners", ""),
    (f"robot = optik.load({str(REPOSITORY / 'examples' / 'arm.urdf')!r}, tip='tool')\nrobot", "joint1"),
    ("print(robot)", "acceleration"),
    ("q = np.deg2rad([0, 40, 50, 0, 60, 0])\nstart = robot.fk(q)\nstart", "array"),
    ("result = optik.solve_ik(robot, start, q + 0.2)\nresult", "solved"),
    ("optik.solve_ik_batch(robot, np.array([start] * 100), q)", "100"),
    ("goal = start.copy(); goal[0, 3] += 9.0\noptik.solve_ik(robot, goal, q)", "unreachable"),
    ("limits = planners.MotionLimits.of(robot, acceleration=10, jerk=100)\nlimits", "acceleration"),
    (
        "goal = start.copy(); goal[:3, 3] += [0.02, 0.05, -0.03]\nplan = planners.plan(robot, goal, q, limits=limits)\nplan",
        "valid",
    ),
    ("plan.certificate", "velocity"),
    ("plan.trajectory", "s"),
    ("print(plan)", "certificate valid"),
    ("far = start.copy(); far[0, 3] += 0.6\nfailed = planners.plan(robot, far, q, limits=limits)\nfailed", "reason"),
    ("failed.trajectory", "!NoSolution"),
    ("planners.plan(robot, goal, q)", "!InvalidInput"),
    ("plan.plot()", ""),
    ("plan.show()", "iframe"),
    ("robot.show(q)", "iframe"),
    ("optik.Scene(boxes=[(optik.se3.pose(p=[0.5, 0.0, 0.3]), [0.1, 0.1, 0.1])])", "box"),
    (SOLVER.format(name="Newton", gain=1.0) + "\noptik.solve_ik(robot, start, q + 0.1, Newton)", "solved"),
    ("planners.plan(robot, goal, q, solver=Newton, limits=limits)", "newton"),
    (
        "from pathlib import Path\n"
        f"Path('halved.py').write_text({(SOLVER.format(name='Halved', gain=0.5) + 'METHOD = Halved')!r})\n"
        "first = optik.solve_ik(robot, start, q + 0.1, './halved.py')\nfirst.iterations",
        "",
    ),
    (
        "text = Path('halved.py').read_text()\n"
        "Path('halved.py').write_text(text.replace('0.5 * np.linalg', '1.0 * np.linalg'))\n"
        "again = optik.solve_ik(robot, start, q + 0.1, './halved.py')\n"
        "plan = planners.plan(robot, goal, q, solver='./halved.py', limits=limits)\n"
        "again.iterations < first.iterations, plan.solver",
        "(True, 'halved@",
    ),
    (
        "Path('halved.py').write_text(text + '\\nthis is no Python')\n"
        "optik.solve_ik(robot, start, q + 0.1, './halved.py')",
        "solved",
    ),
    (
        f"Path('log.csv').write_text({CSV!r})\n"
        "log = planners.load_trajectory('log.csv', robot, interpolation='spline')\n"
        "planners.certify(robot, None, log, limits)",
        "certificate",
    ),
]  # fmt: skip
"""The cells, and what the output of each contains; after ! the name of the error that is intended."""


def texts(cell: Any) -> list[str]:
    """What a notebook shows of a cell's outputs as text: streams, plain results, and errors without colours."""
    shown = []
    for output in cell.outputs:
        if output.output_type == "stream":
            shown.append(output.text)
        elif output.output_type == "error":
            shown.append(f"{output.ename}: {output.evalue}")
        else:
            shown.append(output.data.get("text/plain", ""))
    return shown


def everything(cell: Any) -> str:
    """All forms of all outputs of a cell."""
    return "\n".join([*texts(cell), *(str(x) for o in cell.outputs for x in o.get("data", {}).values())])


@pytest.fixture(name="notebook", scope="module")
def _notebook(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """The notebook after it was run in a kernel, each cell whatever the others raised."""
    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(code) for code, _ in CELLS])
    folder = tmp_path_factory.mktemp("notebook")
    client = NotebookClient(
        notebook, timeout=120, kernel_name="python3", allow_errors=True, resources={"metadata": {"path": str(folder)}}
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", str(REPOSITORY))
        client.execute()
    return notebook


def test_there_are_25_cells() -> None:
    assert len(CELLS) == 25


@pytest.mark.parametrize("index", range(len(CELLS)))
def test_a_cell_says_what_it_should_in_little_text(index: int, notebook: Any) -> None:
    cell, wanted = notebook.cells[index], CELLS[index][1]
    errors = [output for output in cell.outputs if output.output_type == "error"]
    assert [error.ename for error in errors] == ([wanted[1:]] if wanted.startswith("!") else []), cell
    assert all(len(text) <= MOST_TEXT for text in texts(cell)), cell.source
    assert all(error.evalue.strip().count("\n") < 3 for error in errors)
    if not wanted.startswith("!"):
        assert wanted.lower() in everything(cell).lower(), everything(cell)[:3000]
