from typing import Any

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numpy.polynomial import polynomial
from scipy.interpolate import BPoly

from planners.trajectory.curve import quintic, quintic_through

seeds = st.integers(0, 2**31)


def case(seed: int, pieces: int = 4, n: int = 3) -> tuple[Any, Any, Any]:
    """Knots between a millisecond and ten seconds apart, and independent values at both ends of every piece."""
    rng = np.random.default_rng(seed)
    x = np.concatenate([[0.0], np.cumsum(10.0 ** rng.uniform(-3.0, 1.0, pieces))])
    left, right = (tuple(rng.normal(size=(3, pieces, n)) * 10.0 ** rng.uniform(-2, 2, (3, 1, 1))) for _ in range(2))
    return x, left, right


@given(seeds)
def test_each_piece_is_the_polynomial_that_scipy_finds_from_derivatives(seed: int) -> None:
    x, left, right = case(seed)
    p = quintic(x, left, right)
    assert p.c.shape == (6, 4, 3)
    for order in range(3):
        np.testing.assert_allclose(p(x[:-1], order), left[order], rtol=1e-15)
    for k in range(4):
        h = x[k + 1] - x[k]
        u = np.linspace(0.0, h, 13)
        for j in range(3):
            ends = [[row[k, j] for row in left], [row[k, j] for row in right]]
            reference = BPoly.from_derivatives([0.0, h], ends)
            size = max(max(abs(e[0]), abs(e[1]) * h, abs(e[2]) * h * h) for e in ends)
            for order in range(4):
                ours = polynomial.polyval(u, polynomial.polyder(p.c[::-1, k, j], order))
                theirs = reference.derivative(order)(u) if order else reference(u)
                np.testing.assert_allclose(ours, theirs, rtol=0.0, atol=1e-11 * size / h**order)


@given(seeds)
def test_through_is_one_such_piece_after_another(seed: int) -> None:
    x, values, _ = case(seed, pieces=5)
    p = quintic_through(x[:-1], *values)
    pieces = quintic(x[:-1], tuple(row[:-1] for row in values), tuple(row[1:] for row in values))
    np.testing.assert_array_equal(p.x, pieces.x)
    np.testing.assert_array_equal(p.c, pieces.c)
