"""Links of an arm that are in contact in many or all sampled configurations."""

from __future__ import annotations

import warnings
from functools import partial

import numpy as np

from optik.arm.branches import list_drivers, read_range
from optik.arm.model import ArmModel
from optik.arm.shapes.cache import compute_once
from optik.arm.shapes.enclosure import Hull
from optik.arm.shapes.hulls import count_crossings, find_contacts, list_hulls, pack_hulls
from optik.arm.shapes.urdf import MeshFolders, Rows, read_surface
from optik.arm.urdf_tree import Tree
from optik.errors import EnclosureWarning
from optik.types import Array

CONTACT_CONFIGURATIONS, MESH_CONFIGURATIONS = 200, 10_000
"""Numbers of random configurations: of all pairs of links, and of the meshes of pairs in contact in each of the former. A pair
that is free in 3 % of the former is overlooked in 0.2 % of the cases, one that is free in 0.1 % of the latter in 0.005 %."""
OFTEN = 0.5
"""Fraction of the configurations from which a warning names a pair."""
MOST_NAMED = 3
"""Most pairs that a warning names."""
KINDS = np.zeros(7, np.int64)
"""Numbers of the first objects of each kind, of an arm alone."""


def find_contact_shares(arm: ArmModel) -> dict[tuple[str, str], float]:
    """Return for each pair of links with shapes the fraction of sampled configurations in which they are in contact."""
    assert arm.shapes is not None
    names = [(arm.shapes.names[i], arm.shapes.names[j]) for i, j in arm.shapes.pairs.tolist()]
    every = list(dict.fromkeys(names))
    rows = (
        np.column_stack([arm.shapes.pairs, [every.index(pair) for pair in names]]) if names else KINDS[:0].reshape(0, 3)
    )
    touching = np.empty((len(every), CONTACT_CONFIGURATIONS), np.bool_)
    q = arm.limits.sample(np.random.default_rng(0), CONTACT_CONFIGURATIONS)
    find_contacts(arm.axes.chain, pack_hulls(arm.shapes.list_bodies(), KINDS), rows, arm.spread(q), touching)
    return dict(zip(every, touching.mean(axis=1).tolist(), strict=True))


def touch_always(arm: ArmModel, links: tuple[int, int], surfaces: tuple[Array, Array]) -> Array:
    """Return 1 if the surfaces (k, 3, 3) of two links are in contact in each of many sampled configurations, or 0."""
    q = arm.limits.sample(np.random.default_rng(0), MESH_CONFIGURATIONS)
    meshes = [(link, list_hulls([Hull(t, 0.0) for t in of])) for link, of in zip(links, surfaces, strict=True)]
    balls = np.array([list_hulls([Hull(of.reshape(-1, 3), 0.0)])[0][0, 2:6] for of in surfaces])
    return np.array([float(count_crossings(arm.axes.chain, pack_hulls(meshes, KINDS), balls, arm.spread(q)) == len(q))])


def leave_out_contact(arm: ArmModel, tree: Tree, rows: Rows, folders: MeshFolders) -> ArmModel:
    """Leave out the pairs of links whose meshes are always in contact; warn of them, and of pairs that often are."""
    assert arm.shapes is not None
    where = {link: (number, T) for number, T, link in rows}
    source = arm.shapes.content, *arm.chain, arm.limits.lower, arm.limits.upper
    shares = find_contact_shares(arm)
    always = []
    for pair in [pair for pair, share in shares.items() if share == 1.0 and where.keys() >= {*pair}]:
        one, other = (read_surface(tree, link, where[link][1], folders) for link in pair)
        if len(one) and len(other):
            check = partial(touch_always, arm, (where[pair[0]][0], where[pair[1]][0]), (one, other))
            if compute_once(check, *source, *pair, one, other)[0]:
                always.append(pair)
    if always:
        why = f"in contact in each of {MESH_CONFIGURATIONS:,} sampled configurations"
        problem = (
            f"the meshes of {_list(always)} are {why}: not checked. If they may collide, give meshes that are apart where the "
            "links are (srdf= names the pairs of the maker)"
        )
        warnings.warn(EnclosureWarning(arm.name, problem, always), stacklevel=4)
        arm = arm.with_shapes(arm.shapes.with_apart((*pair, f"meshes {why}") for pair in always))
    if touching := [pair for pair, share in shares.items() if share >= OFTEN and pair not in always]:
        _warn_of_contact(arm, tree, {pair: shares[pair] for pair in touching}, set(where))
    return arm


def _list(pairs: list[tuple[str, str]]) -> str:
    """Return pairs as words."""
    more = f" and {len(pairs) - MOST_NAMED} more pairs" if len(pairs) > MOST_NAMED else ""
    return ", ".join(f"{one!r} and {other!r}" for one, other in pairs[:MOST_NAMED]) + more


def _warn_of_contact(arm: ArmModel, tree: Tree, shares: dict[tuple[str, str], float], chain: set[str]) -> None:
    """Warn of links of an arm whose shapes are in contact in many sampled configurations."""
    moved = {
        joint.name: joint for name in dict.fromkeys(name for pair in shares for name in pair)
        for joint in (list_drivers(tree, name, chain) if name in tree.above else ())
    }  # fmt: skip
    held = {name: float(np.clip(0.0, *read_range(tree.name, joint))) for name, joint in moved.items()}
    advice = (
        f"hold joints (values={held}), or leave the pairs out" if held else "leave the pairs out if they cannot collide"
    )
    always = [pair for pair, share in shares.items() if share == 1.0]
    part = "each" if always else f"{100.0 * max(shares.values()):.0f} %"
    problem = (
        f"the shapes of {_list(always or sorted(shares, key=shares.__getitem__)[::-1])} are in contact in {part} of "
        f"{CONTACT_CONFIGURATIONS} sampled configurations, so {'every motion' if always else 'most motions'} in a scene "
        f"{'is' if always else 'are'} refused: {advice} (srdf=, or shapes.with_apart)"
    )
    warnings.warn(EnclosureWarning(arm.name, problem, shares), stacklevel=5)
