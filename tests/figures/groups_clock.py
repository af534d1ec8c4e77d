"""Pairs of motions on one clock: what combine() proves of the distance between two arms, with no wait and after one.

Oracle: coal on the capsules of both arms, each placed by its own forward kinematics, at 1 kHz.
Measured: 0 of 650 proved touch, all 648 at least 1 mm apart are proved; 73 more after a wait, of which 0 touch.
"""

from __future__ import annotations

import numpy as np

import optik
import planners
from optik import Group, Robot, Scene, se3
from optik.scene.contact import find_nearest_pairs
from optik.types import Array
from tests.figures.figure import Row, Value, main
from tests.planners.contacts import COAL_ERROR, Oracle, instants

PAIRS, WITHIN, CLEAR, RATE = 1000, 0.02, 1e-3, 1000.0
"""Number of pairs; distances that coal is asked for, and from which a proof is asked for [m]; rate of sampling [Hz]."""
ARMS = ("ur5e", "ur10e", "panda", "iiwa14")


def limited(name: str) -> Robot:
    """An arm with equal limits."""
    arm = optik.load(name)
    rates = {"acceleration": np.full(arm.n, 10.0), "jerk": np.full(arm.n, 100.0)}
    return arm.with_limits(velocity=np.minimum(2.0, arm.limits.velocity), **rates)


class GroupOracle(Oracle):
    """Distances between two members by coal: the capsules of both in the world, and the pairs between them."""

    def __init__(self, group: Group) -> None:
        self.group, (one, other) = group, group.members.values()
        super().__init__(one, Scene())
        second, m, n = Oracle(other, Scene()), len(self.link), one.n
        self.pairs = [(i, m + j) for i, a in enumerate(self.link) for j, b in enumerate(second.link) if a or b]
        self.link = np.append(self.link, second.link + n + 1)
        self.a, self.b = np.concatenate([self.a, second.a]), np.concatenate([self.b, second.b])
        self.radius, self.half = np.append(self.radius, second.radius), np.append(self.half, second.half)
        self.parts, self.robot, self.moving = self.parts + second.parts, self, np.empty(0, np.int64)

    def frames(self, q: Array) -> Array:
        """The links of the first member, the base of the second one, its links, and a last pose, which is not used."""
        base = np.broadcast_to(np.eye(4), (len(q), 1, 4, 4))
        (one, a), (other, b) = zip(self.group.members.values(), self.group.split(q).values(), strict=True)
        return np.concatenate([one.frames(a)[:, :-1], base, other.frames(b)], axis=1)

    def least(self, q: Array) -> float:
        """The least distance between the members at configurations (k, n) of the group [m]; infinite above `WITHIN`."""
        return float(self.near(q, WITHIN, WITHIN).own.min())


def sample(found: planners.Plan, rate: float = RATE) -> Array:
    """The configurations of a motion."""
    return np.asarray(found.trajectory(instants(found.trajectory, rate)))


def draw(rng: np.random.Generator) -> list[planners.Plan]:
    """Motions of two arms with near bases, whose ends are free of contact."""
    while True:
        names, turn = rng.choice(ARMS, 2), se3.exp_so3([0.0, 0.0, rng.uniform(-np.pi, np.pi)])
        place = se3.pose(turn, rng.uniform(0.5, 1.0) * turn[:, 0] + [0.0, 0.0, rng.uniform(-0.2, 0.4)])
        group = Group(left=limited(names[0]), right=limited(names[1]).with_base(place))
        ends = np.concatenate(
            [one.limits.clip(rng.uniform(-2.5, 2.5, (200, one.n))) for one in group.members.values()], 1
        )
        near = [np.linalg.norm(T[:, :3, 3] - 0.5 * place[:3, 3], axis=1) < 0.9 for T in group.fk(ends).values()]
        ends = ends[near[0] & near[1]]
        rooms = find_nearest_pairs(group.chain("left", "right"), Scene(), ends[:, group.order("left", "right")])[0]
        if (rooms > 0.0).sum() < 2:
            continue
        joints = group.split(ends[rooms > 0.0][:2])
        each = [
            planners.plan(one, joints[name][1], joints[name][0], scene=Scene()) for name, one in group.members.items()
        ]
        if all(each):
            return each


def measure(case: int) -> Row:
    first, second = draw(np.random.default_rng([case, 581]))
    both = planners.combine(first, second)
    oracle = GroupOracle(both.group)
    T = max(first.duration, second.duration)
    alone = np.concatenate(
        [
            one.trajectory(np.minimum(np.arange(0.0, T + 1.0 / RATE, 1.0 / RATE), one.duration))
            for one in (first, second)
        ],
        axis=1,
    )
    row: Row = {"solved": bool(both), "wait": max(both.chain_plan.waits.values()), "coal": oracle.least(alone)}
    row["proved"] = row["solved"] and row["wait"] == 0.0
    row["waited"] = oracle.least(sample(both)) if row["wait"] else row["coal"]
    if row["solved"]:
        row["bound"] = min(both.clearances["left and right"].own.value, WITHIN)
    return row


def judge(rows: list[Row]) -> list[Value]:
    proved, apart = [row for row in rows if row["proved"]], [row for row in rows if row["coal"] >= CLEAR]
    waited = [row for row in rows if row["solved"] and row["wait"]]
    wrong = sum(row["coal"] < -COAL_ERROR for row in proved)
    late = sum(row["waited"] < -COAL_ERROR for row in waited)
    above = max(row["bound"] - row["waited"] for row in rows if row["solved"])
    share = sum(row["proved"] for row in apart) / len(apart)
    return [
        Value("proved apart and touching by coal", "0", f"{wrong} of {len(proved)}", not wrong),
        Value("at least 1 mm apart by coal, proved", "99 %", f"{100 * share:.2f} % of {len(apart)}", share >= 0.99),
        Value("proved after a wait and touching by coal", "0", f"{late} of {len(waited)}", not late),
        Value("proved distance above that by coal [m]", "0", f"{above:.2g}", above <= COAL_ERROR),
    ]


if __name__ == "__main__":
    main("groups_clock", measure, PAIRS, judge)
