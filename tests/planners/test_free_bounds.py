"""The barrier of the bounds of a free path's coefficients, apart from the motion: one Newton step against its equations."""

import numpy as np
import pytest

from planners.choice.solve import _Box
from planners.paths.control_curve import ControlBounds

MU, DAMPING = 0.01, 1e-6
FREE = np.array([[True, True, True], [False, True, False], [True, False, True], [False, False, False]])
"""Which of 4 × 3 coefficients may change; the first two of a row lie in a disc."""


def box(seed: int) -> tuple[_Box, np.ndarray]:
    rng = np.random.default_rng(seed)
    bounds = ControlBounds(np.full((4, 3), -0.5), np.full((4, 3), 0.7), ((0, 0.6),))
    p = rng.uniform(-0.3, 0.3, (4, 3))
    return _Box(bounds, FREE.ravel(), p, MU), p


@pytest.mark.parametrize("seed", range(5))
def test_a_held_coefficient_is_a_row_of_the_identity(seed: int) -> None:
    each, p = box(seed)
    own, pull = np.empty((12, 3)), np.empty(12)
    each.model(p, MU, own, pull, DAMPING)
    H = own.reshape(4, 3, 3)
    for k, i in zip(*np.nonzero(~FREE), strict=True):
        np.testing.assert_array_equal(H[k, i], np.eye(3)[i])
        assert pull.reshape(4, 3)[k, i] == 0.0
    barrier = MU * (1.0 / (0.7 - p) ** 2 + 1.0 / (p + 0.5) ** 2) + DAMPING
    np.testing.assert_allclose(H[FREE[:, 2], 2, 2], barrier[FREE[:, 2], 2], rtol=1e-12)
    assert (np.einsum("kii->ki", H)[FREE] >= barrier[FREE] * (1.0 - 1e-12)).all()  # the disc adds to it


@pytest.mark.parametrize("seed", range(5))
def test_a_whole_newton_step_meets_the_linearised_equations(seed: int) -> None:
    """Slack and multiplier: s λ = μ, and c + s = 1 where c is linear: both but for the product of the steps."""
    each, p = box(seed)
    dp = np.where(FREE, np.random.default_rng([1, seed]).uniform(-0.02, 0.02, p.shape), 0.0)
    each.dual[:] *= np.random.default_rng([2, seed]).uniform(0.5, 2.0, each.dual.shape)
    each.step(p, dp, MU, 0.99)
    active, product = np.broadcast_to(each.active, each.slack.shape), each.dslack * each.ddual
    c = each.values(p + dp)
    each.accept(c, 1.0, 1.0)
    np.testing.assert_allclose(
        (each.slack * each.dual)[..., :3][active[..., :3]], (MU + product)[..., :3][active[..., :3]]
    )
    for side, sign in enumerate((1.0, -1.0)):
        off = each.slack[side] + sign * c - 1.0
        np.testing.assert_allclose(off[:, :3][each.active[:, :3]], 0.0, atol=1e-14)
