"""Links of an arm that are in contact in every sampled configuration, because their shapes enclose too much."""

from __future__ import annotations

import warnings

import numpy as np

from optik import kinematics
from optik.arm.branches import list_drivers, read_range
from optik.arm.model import ArmModel
from optik.arm.urdf_tree import Tree
from optik.errors import EnclosureWarning
from optik.types import Array

CONTACT_CONFIGURATIONS = 200
"""Number of random configurations: a pair that is free in 3 % of them is overlooked in 0.2 % of the cases."""
MOST_NAMED = 3
"""Most pairs that a warning names."""


def find_always_touching(arm: ArmModel) -> list[tuple[str, str]]:
    """Return the names of the pairs of links with shapes that are in contact in every sampled configuration."""
    assert arm.shapes is not None
    link, a, b, radius = arm.shapes.capsules
    q = arm.limits.sample(np.random.default_rng(0), CONTACT_CONFIGURATIONS)
    T = np.tile(np.eye(4), (len(q), len(arm.fixed) + 2, 1, 1))
    frames = np.empty((len(q), len(arm.fixed) + 1, 4, 4))
    kinematics.frames_batch(arm.chain, q, frames)
    T[:, 1:] = frames
    T = T[:, link].swapaxes(0, 1)  # of each capsule in each configuration
    ends = [np.einsum("mkij,mj->mki", T[..., :3, :3], x) + T[..., :3, 3] for x in (a, b)]
    pairs_of: dict[tuple[str, str], list[tuple[int, int]]] = {}
    for i, j in arm.shapes.pairs.tolist():
        pairs_of.setdefault((arm.shapes.names[i], arm.shapes.names[j]), []).append((i, j))
    found = []
    for names, pairs in pairs_of.items():
        i, j = np.array(pairs).T
        for some in (slice(0, 4), slice(None)):  # most pairs are apart in one of the first
            apart = segment_distances(*(x[k][:, some] for k in (i, j) for x in ends)) > (radius[i] + radius[j])[:, None]
            if apart.all(axis=0).any():
                break
        else:
            found.append(names)
    return found


def segment_distances(a: Array, b: Array, c: Array, d: Array) -> Array:
    """Return the distances of segments from a to b and from c to d, all (..., 3) [m]."""
    u, v, w = b - a, d - c, a - c
    uu, uv, vv, uw, vw = ((x * y).sum(axis=-1) for x, y in ((u, u), (u, v), (v, v), (u, w), (v, w)))
    tiny = np.finfo(np.float64).tiny
    s = np.clip((uv * vw - vv * uw) / np.maximum(uu * vv - uv * uv, tiny), 0.0, 1.0)
    t = np.clip((uv * s + vw) / np.maximum(vv, tiny), 0.0, 1.0)
    s = np.clip((uv * t - uw) / np.maximum(uu, tiny), 0.0, 1.0)
    return np.asarray(np.linalg.norm(w + s[..., None] * u - t[..., None] * v, axis=-1))


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
    problem = (
        f"the shapes of {words}{more} are in contact in each of {CONTACT_CONFIGURATIONS} sampled configurations, so every "
        f"motion in a scene is refused: {advice} (srdf=, or shapes.with_apart)"
    )
    warnings.warn(EnclosureWarning(arm.name, problem, found), stacklevel=4)
