"""Links of an arm that are in contact in every sampled configuration, because their shapes enclose too much."""

from __future__ import annotations

import warnings

import numpy as np

from optik.arm.branches import list_drivers, read_range
from optik.arm.model import ArmModel
from optik.arm.urdf_tree import Tree
from optik.errors import EnclosureWarning
from optik.scene import Scene
from optik.scene.contact import SELF, rooms_batch

SAMPLES = 200
"""Number of random configurations: a pair that is free in 3 % of them is overlooked in 0.2 % of the cases."""
MOST_NAMED = 3
"""Most pairs that a warning names."""


def find_always_touching(arm: ArmModel) -> list[tuple[str, str]]:
    """Return the names of the pairs of links with shapes that are in contact in every sampled configuration."""
    assert arm.shapes is not None
    shapes, link = arm.shapes, arm.shapes.capsules[0]
    pairs = np.array([(i, j, SELF) if link[i] > link[j] else (j, i, SELF) for i, j in shapes.pairs.tolist()])
    names = [(shapes.names[j], shapes.names[i]) for i, j, _ in pairs.tolist()]
    q = arm.limits.sample(np.random.default_rng(0), SAMPLES)
    room, which, found = np.empty(SAMPLES), np.empty(SAMPLES, np.int64), []
    for pair in dict.fromkeys(names):
        of_pair = pairs[[name == pair for name in names]]
        for some in (slice(0, 4), slice(None)):  # most pairs are apart in one of the first
            bodies = (shapes.capsules, Scene().arrays, of_pair)
            rooms_batch(arm.chain, bodies, q[some], 0.0, room[some], which[some])
            if (room[some] > 0.0).any():
                break
        else:
            found.append(pair)
    return found


def warn_of_contact(arm: ArmModel, tree: Tree, chain: set[str]) -> None:
    """Warn of links of an arm whose shapes are in contact in every sampled configuration."""
    found = find_always_touching(arm)
    if not found:
        return
    moved = {
        joint.name: joint for name in dict.fromkeys(name for pair in found for name in pair)
        for joint in (list_drivers(tree, name, chain) if name in tree.above else ())
    }  # fmt: skip
    held = {name: float(np.clip(0.0, *read_range(tree.name, joint))) for name, joint in moved.items()}
    advice = f"hold joints (values={held}), or leave the pairs out" if held else "leave the pairs out"
    words = ", ".join(f"{one!r} and {other!r}" for one, other in found[:MOST_NAMED])
    more = f" and {len(found) - MOST_NAMED} more pairs" if len(found) > MOST_NAMED else ""
    warnings.warn(
        EnclosureWarning(
            f"robot {arm.name!r}: the shapes of {words}{more} are in contact in each of {SAMPLES} sampled configurations, so "
            f"every motion in a scene is refused: {advice} (srdf=, or shapes.with_apart)",
            found,
        ),
        stacklevel=4,
    )
