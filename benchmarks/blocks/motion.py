"""Motions around obstacles: MotionBenchMaker's problems, by our plan and by polylines that are rounded and timed."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import suppress
from itertools import pairwise, zip_longest
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any

import numpy as np
import polars as pl
from pydantic import AfterValidator

from benchmarks.blocks.base import NUMBER, TEXT, TRUTH, WHOLE, Field, Kind, Session, Trials, fields_of
from benchmarks.blocks.block import Block, Column, Entry, Target, count, mean, median, quantile, share
from benchmarks.blocks.timing.settings import LimitSet
from benchmarks.peers.base import Absent
from benchmarks.peers.pyroboplan_motions import move_by_pyroboplan
from benchmarks.peers.vamp_search import find_by_vamp
from benchmarks.problems.motionbench import MotionProblem, follow_curobo, read_archive, read_problem, write_problems
from benchmarks.records import UNKEPT, Journal
from benchmarks.settings import Count, RobotName, key, one_of
from optik.arm.library import load
from optik.arm.robot import Robot
from optik.errors import InvalidInput, MissingDependency, NoSolution
from optik.ik import get_solver
from optik.ik.base import Tolerance
from optik.plugins.files import resolve_data_file
from optik.scene import Scene
from optik.scene.contact import find_contact
from optik.types import Array
from planners.certificate.certificate import Certificate
from planners.certificate.certification import certify
from planners.choice.first_paths import round_legs
from planners.following.follow import DEFAULT_TOLERANCE, follow
from planners.limits import MotionLimits
from planners.motion.motion import stretch_analysed
from planners.paths.joint_line import JointLine
from planners.paths.point_to_point import PointToPoint
from planners.plan import Plan, plan
from planners.planning.planner import PlanRequest
from planners.planning.result import judge_certificate
from planners.search.base import JointSpace, SearchResult, SearchStatus, measure_length
from planners.search.find import find_path, list_goals
from planners.timing import make_law
from planners.trajectory.trajectory import Trajectory

OURS = "path and time"
"""Label of our plan."""
ROUNDED = {
    "own, rounded": ("rrt_connect", "optimal"),
    "OMPL, rounded": ("ompl", "optimal"),
    "OMPL, toppra": ("ompl", "toppra"),
    "VAMP, rounded": ("vamp", "optimal"),
}
"""Polylines with rounded corners: the search and the time law. TOPP-RA does not limit the jerk."""
PYROBOPLAN = "pyroboplan"
"""Label of the peer that searches and times its motions, which are certified as they are, without the limit of the jerk."""
OF_OMPL = "OMPL, rounded"
"""Label of the peer whose duration ours is compared with."""
EQUAL = 1e-6
"""Relative tolerance: a duration counts as longer than the peer's only beyond this fraction."""
SAMPLED_RATE = 1000.0
"""Rate at which a motion's length, jerk, torques and energy are sampled [Hz]."""
WHERE = (
    "a tar file of problems, such as resources/panda/problems.tar.bz2 of github.com/KavrakiLab/vamp; "
    "without this key the block generates problems"
)
"""What the key `problems` names."""

COUNTED = ~pl.col("touched")
"""Problems whose start and goal are collision-free."""
MEASURES = (
    Column("problems", "problems", show="count", of=len),
    Column("found", "path found", "%", "more", "share", of=share("found")),
    Column("solved", "proved motion", "%", "more", "share", of=share("solved")),
    Column("contacts", "in contact", show="count", of=count("contact")),
    Column("exceeded", "over a limit", show="count", of=count("exceeded")),
    Column("median_duration", "median duration", "s", of=quantile("duration", 0.5, among="solved")),
    Column("median_over_stops", "over stops, median", of=median("over_stops")),
    Column("not_longer", f"not longer than {OF_OMPL}", "%", show="share",
           of=share("not_longer", among=pl.col("not_longer").is_not_null())),
    Column("median_ms", "median CPU time", "ms", "less", of=quantile("ms", 0.5)),
    Column("p95_ms", "p95 CPU time", "ms", "less", of=quantile("ms", 0.95)),
    Column("search_ms", "median CPU time of the search", "ms", aside=True, of=quantile("search_ms", 0.5)),
    Column("mean_length", "mean length of the polyline", "rad", aside=True, of=mean("length")),
    Column("travel", "mean length of the motion", "rad", aside=True, of=mean("travel")),
    Column("jerk", "median of the largest jerk", "rad/s³", aside=True, of=median("jerk")),
    Column("torque", "median of the largest torque", "N·m", aside=True, of=median("torque")),
    Column("energy", "median energy, ∫|τ q̇| dt", "J", aside=True, of=median("energy")),
    Column("rounds", "mean rounds", aside=True, of=mean("rounds")),
)  # fmt: skip
"""Measures: columns of the table of a block, which its targets can name; of durations, among the proved motions."""


def _find_problems(name: str) -> str:
    """Return the path of the file, which starts at the suite's folder, or else at the working folder."""
    with suppress(InvalidInput):  # said when the block is prepared: suites can be read without the file
        return resolve_data_file(name, "problems") if name else name
    return name


class MotionBlock(Block):
    """Motion problems of one arm: obstacles, a start and a goal in joint space."""

    noun = "motion block"
    measures = MEASURES

    robot: RobotName = key("The arm: a name, or the path of a file; it must have shapes.")
    problems: Annotated[str, AfterValidator(_find_problems)] = key(
        "Tar file of MotionBenchMaker's problems; by default the block generates problems.", ""
    )
    count: Count = key("Number of problems, equally many of each kind of scene.")
    grasping: tuple[str, ...] = key("Parts of the arm that may touch the object at the goal.", ())
    rules: Annotated[str, one_of("archive", "curobo")] = key(
        "`archive`: start and goal of the file. `curobo`: cuRobo's start, the pose of the tool at the goal, cylinders of "
        "10 mm in place of 30 mm, and a stand under the arm.", "archive",
    )  # fmt: skip
    masses: str = key("Arm with the same joints whose masses give torques and energy; by default the arm itself.", "")
    limits: LimitSet = key("Limits of the motions, as in `[[timing]]`.")
    peers: tuple[Annotated[str, one_of(*ROUNDED, PYROBOPLAN)], ...] = key(
        "Searches whose polylines are rounded and timed: `own, rounded`, `OMPL, rounded`, `OMPL, toppra`, `VAMP, rounded`; "
        "and `pyroboplan`.", tuple(ROUNDED)[:3],
    )  # fmt: skip

    @property
    def entries(self) -> tuple[Entry, ...]:
        """Our plan, then the rounded polylines."""
        laws = {PYROBOPLAN: PYROBOPLAN} | {name: law for name, (_search, law) in ROUNDED.items()}
        others = (Entry(name, laws[name], {}, role="law" if "own" in name else "peer") for name in self.peers)
        return (Entry(OURS, "optimal", {}), *others)

    def read_problems(self, robot: Robot, seed: int) -> list[tuple[str, int, MotionProblem]]:
        """Return kind, number and content of each problem, in turn of each kind."""
        with TemporaryDirectory() as folder:
            file = Path(self.problems)
            if not self.problems:
                file = Path(folder) / "problems.tar.bz2"
                write_problems(file, robot, seed, self.count)
            elif not file.is_file():
                raise InvalidInput(f"motion block {self.id!r}: problems", repr(self.problems), WHERE)
            of_kinds: dict[str, list[tuple[str, int]]] = {}
            for at in read_archive(file):
                of_kinds.setdefault(at[0], []).append(at)
            chosen = [at for turn in zip_longest(*of_kinds.values()) for at in turn if at][: self.count]
            found = [(kind, n, read_problem(file, kind, n, robot, self.grasping)) for kind, n in chosen]
        of_rules = {"archive": lambda _robot, problem: problem, "curobo": follow_curobo}[self.rules]
        return [(kind, n, of_rules(robot, problem)) for kind, n, problem in found]


# ---------------------------------------------------------------- problems


def find_touching_end(robot: Robot, problem: MotionProblem) -> str:
    """Return the reason if the start or the goal is in collision or outside the limits, else an empty string."""
    ends = [("start", problem.start)]
    if problem.goal.ndim == 1:
        ends.append(("goal", problem.goal))
    elif not len(list_goals(JointSpace(robot, problem.scene), problem.start, problem.goal, "exact")[0]):
        return "no configuration of the goal is free"
    for which, q in ends:
        if not robot.limits.contains(q):
            return f"the {which} is outside the joint limits"
        if (near := find_contact(robot, problem.scene, q)).room <= 0.0:
            return f"the {which} is in contact: {near.pair[0]} and {near.pair[1]}"
    return ""


def time_rounded(robot: Robot, limits: MotionLimits, scene: Scene, found: SearchResult, law: str) -> Plan | None:
    """Return the certified motion of a law along the polyline of a search with rounded corners; None if the law finds none."""
    if law == "toppra":
        limits = MotionLimits(limits.velocity, limits.acceleration)
    ends = found.vertices[0], found.vertices[-1]
    path, made = round_legs(PointToPoint(robot, *ends), [found.vertices], scene), make_law(law)
    joints = follow(get_solver(robot, "lm"), path).joint_path
    if joints is None:
        return None
    try:
        motion = stretch_analysed(made.run_with_analysis(joints, limits), limits, made.list_enforced(limits))
    except NoSolution:
        return None
    request = PlanRequest(robot, path, limits, "lm", made, Tolerance.of(DEFAULT_TOLERANCE), 1000.0, scene=scene)
    return request.certify_motion(joints, motion.trajectory, 1.0, motion)


def _judge(made: Plan | None, ms: float, heavy: Robot) -> dict[str, Any]:
    """Return the columns of a row that describe a plan."""
    if made is None:
        return {"status": "timing_infeasible", "ms": ms, "solved": False}
    row: dict[str, Any] = {"status": str(made.status), "ms": ms, "solved": bool(made)}
    row["reason"] = "" if made.failure is None else made.failure.reason
    if made.has_motion:
        row |= _judge_proof(made.certificate)
    return row | (_measure_motion(made.trajectory, heavy) if made else {"duration": None})


def _measure_motion(motion: Trajectory, heavy: Robot) -> dict[str, Any]:
    """Return duration, length in joint space and largest jerk; of an arm with masses, largest torque and mechanical energy."""
    t = np.linspace(0.0, motion.duration, 1 + round(SAMPLED_RATE * motion.duration))
    v, step = motion(t, 1), motion.duration / (len(t) - 1)
    row = {"duration": motion.duration, "travel": float(np.linalg.norm(v, axis=1).sum() * step)}
    row["jerk"] = float(np.abs(motion(t, 3)).max())
    if heavy.inertia is not None:
        torques = heavy.torques(motion(t), v, motion(t, 2))
        row |= {"torque": float(np.abs(torques).max()), "energy": float(np.abs(torques * v).sum() * step)}
    return row


def _judge_proof(proof: Certificate) -> dict[str, Any]:
    """Return whether a motion is in contact, and whether it exceeds a limit."""
    exceeded = any(one.allow in ("limits", "jerk") for one in proof.violations)
    return {"contact": proof.clearance is not None and proof.clearance.touches, "exceeded": exceeded}


def solve_by_pyroboplan(robot: Robot, limits: MotionLimits, problem: MotionProblem) -> dict[str, Any]:
    """Return the row of pyroboplan's motion."""
    try:
        path, motion, search_ms, ms = move_by_pyroboplan(robot, limits, problem.scene, (problem.start, problem.goal))
    except NoSolution as error:
        return {"found": False, "solved": False, "status": str(SearchStatus.NO_PATH_FOUND), "reason": str(error)}
    proof = certify(robot, None, motion, MotionLimits(limits.velocity, limits.acceleration), scene=problem.scene)
    status, failure = judge_certificate(proof)
    return _judge_proof(proof) | {
        "found": True, "search_ms": search_ms, "ms": ms, "length": measure_length(path), "edges": len(path) - 1,
        "status": str(status), "reason": "" if failure is None else failure.reason, "solved": proof.is_valid,
        "duration": motion.duration if proof.is_valid else None,
    }  # fmt: skip


def find_polyline(robot: Robot, scene: Scene, ends: tuple[Array, Array], search: str) -> SearchResult:
    """Return the polyline of a search. Edges of our search and of OMPL are proved; those of VAMP are sampled."""
    if search != "vamp":
        return find_path(robot, *ends, scene=scene, search=search, winding="exact")
    if ends[1].ndim == 2:
        raise Absent("VAMP takes goals in joint space")
    try:
        return find_by_vamp(robot, scene, ends)
    except NoSolution as error:
        return SearchResult(SearchStatus.NO_PATH_FOUND, (), 0, str(error))


def solve_by_all(
    block: MotionBlock, robot: Robot, limits: MotionLimits, problem: MotionProblem, journal: Journal = UNKEPT
) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield label and row of our plan and of each peer whose package is installed, with the peer at work in a journal."""
    scene, ends, heavy = problem.scene, (problem.start, problem.goal), load(block.masses) if block.masses else robot
    searches: dict[str, tuple[SearchResult, dict[str, Any]]] = {}
    row: dict[str, Any]
    for name in ("rrt_connect", *dict.fromkeys(ROUNDED[label][0] for label in block.peers if label in ROUNDED)):
        begin, label = time.process_time(), next((one for one in block.peers if ROUNDED.get(one, ("",))[0] == name), "")
        if name != "rrt_connect" and label in journal.crashed:
            continue
        with suppress(MissingDependency, Absent), journal.at_work("" if name == "rrt_connect" else label):
            route = find_polyline(robot, scene, ends, name)
            row = {"found": bool(route), "search_ms": 1e3 * (time.process_time() - begin), "reason": route.reason}
            about = (
                {"length": route.length, "edges": len(route.vertices) - 1} if route else {"status": str(route.status)}
            )
            searches[name] = route, row | about
    route, row = searches["rrt_connect"]
    begin = time.process_time()
    motion = plan(robot, ends[1], ends[0], limits=limits, scene=scene, avoid=True, winding="exact")
    ours = row | _judge(motion, 1e3 * (time.process_time() - begin), heavy)
    if route:
        moves = [plan(robot, JointLine(robot, a, b), a, limits=limits) for a, b in pairwise(route.vertices)]
        ours["stops"] = sum(one.trajectory.duration for one in moves) if all(moves) else None
    yield OURS, ours | {"rounds": None if motion.search is None else motion.search.rounds}
    for label in block.peers:
        if why := next(
            (journal.crashed[one] for one in block.peers if one in journal.crashed and _shares(one, label)), ""
        ):
            yield label, METHOD().lost(reason=why)
            continue
        if label == PYROBOPLAN and ends[1].ndim == 1:
            with suppress(Absent):
                yield label, solve_by_pyroboplan(robot, limits, problem)
            continue
        search, law = ROUNDED.get(label, ("", ""))
        if search not in searches:
            continue
        route, row = searches[search]
        begin = time.process_time()
        if route:
            timed = time_rounded(robot, limits, scene, route, law)
            row = row | _judge(timed, row["search_ms"] + 1e3 * (time.process_time() - begin), heavy)
        yield label, {"solved": False} | row


def _shares(peer: str, label: str) -> bool:
    """Return whether a peer uses the search of another one."""
    return peer == label or (peer in ROUNDED and label in ROUNDED and ROUNDED[peer][0] == ROUNDED[label][0])


FIELDS = {
    "method": TEXT, "problem": WHOLE, "kind": TEXT, "number": WHOLE, **fields_of(TRUTH, "touched moved"),
    "status": Field(pl.String, "crashed"), "reason": TEXT, "found": Field(pl.Boolean, False), "length": NUMBER,
    "edges": WHOLE, "search_ms": NUMBER,
    "ms": Field(pl.Float64, None, "CPU time of a plan", "ms", "less", only="solved", clock="cpu"), "rounds": WHOLE,
    "duration": Field(pl.Float64, None, "duration", "s", "less", only="solved"), "stops": NUMBER,
    **fields_of(NUMBER, "travel jerk torque energy"),
    "solved": Field(pl.Boolean, False, "motions solved", "%", "more", exact=True), **fields_of(TRUTH, "contact exceeded"),
}  # fmt: skip
"""Fields of the rows: duration is that of a solved motion; contact and exceeded are those of any motion that was returned."""


class _Motion(Kind):
    """Blocks of motion problems."""

    name = "motion"
    title = "Motions around obstacles"
    block = MotionBlock
    fields = FIELDS
    order = 64

    def prepare(self, block: MotionBlock, seed: int) -> list[tuple[str, int, MotionProblem]]:
        """Check the limits on the arm, and read the problems."""
        robot = load(block.robot)
        block.limits.of(robot)
        return block.read_problems(robot, seed)

    def share(self, session: Session) -> None:
        """Solve the first problem whose ends are free, which compiles."""
        block, robot = session.block, load(session.block.robot)
        for first in [problem for *_, problem in session.prepared if not find_touching_end(robot, problem)][:1]:
            list(solve_by_all(block, robot, block.limits.of(robot), first, session.journal))

    def count(self, block: MotionBlock, session: Session) -> int:
        return len(session.prepared)

    def solve(self, trials: Trials) -> Iterator[dict[str, Any]]:
        """Solve some problems by all methods."""
        assert trials.session is not None
        block, robot = trials.block, load(trials.block.robot)
        limits, session = block.limits.of(robot), trials.session
        _ = session.shared
        for index in trials.numbers:
            kind, number, problem = session.prepared[index]
            reason = find_touching_end(robot, problem)
            about = {"problem": index, "kind": kind, "number": number, "touched": bool(reason), "moved": problem.moved}
            if reason:
                status = "outside the limits" if "limits" in reason else "contact"
                yield from ({"method": label, "status": status, "reason": reason} | about for label in block.labels)
                continue
            for label, row in solve_by_all(block, robot, limits, problem, session.journal):
                yield {"method": label} | row | about

    def complete(self, rows: pl.DataFrame, block: MotionBlock) -> pl.DataFrame:
        """Add the duration over stops where the polyline has a vertex, and whether ours is not longer than OMPL's."""
        theirs = rows.filter(pl.col("method") == OF_OMPL).select("problem", theirs="duration")
        stops = rows.filter(pl.col("method") == OURS, pl.col("edges") > 1).select("problem", before="stops")
        both = rows.join(theirs, on="problem", how="left").join(stops, on="problem", how="left")
        return both.with_columns(
            over_stops=pl.col("duration") / pl.col("before"),  # null where the polyline is straight
            not_longer=pl.when(pl.col("method") == OURS).then(pl.col("duration") <= (1.0 + EQUAL) * pl.col("theirs")),
        ).drop("theirs")

    def judged_rows(self, rows: pl.DataFrame, target: Target) -> tuple[pl.DataFrame, str]:
        """Return the rows of ours, or of a named peer, of problems whose ends are free."""
        chosen = rows.filter(COUNTED, pl.col("method") == (target.method or OURS))
        return chosen, f"{len(chosen):,} problems"


METHOD = _Motion
