from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.polynomial import polynomial
from scipy.interpolate import BPoly

from planners.curve import quintic, quintic_through

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
def test_the_values_at_each_end_of_each_piece_are_those_given_for_that_side(seed: int) -> None:
    x, left, right = case(seed)
    p = quintic(x, left, right)
    for k in range(4):
        h = x[k + 1] - x[k]
        size = max(np.abs([left[i][k], right[i][k]]).max() * h**i for i in range(3))
        for order in range(3):
            d = p.derivative(order) if order else p
            at_left = d.c[-1, k]
            at_right = np.array([np.polyval(d.c[:, k, j], h) for j in range(3)])
            np.testing.assert_allclose(at_left, left[order][k], rtol=1e-15)
            np.testing.assert_allclose(at_right, right[order][k], rtol=0.0, atol=1e-12 * size / h**order)


@given(seeds)
def test_a_polynomial_of_degree_five_is_reproduced(seed: int) -> None:
    rng = np.random.default_rng(seed)
    x = np.concatenate([[0.0], np.cumsum(rng.uniform(0.2, 1.0, 3))])
    c = rng.normal(size=6)
    values = [polynomial.polyval(x, polynomial.polyder(c, order))[:, None] for order in range(3)]
    p = quintic_through(x, *values)
    t = np.linspace(0.0, x[-1], 50)
    for order in range(6):
        wanted = polynomial.polyval(t, polynomial.polyder(c, order))
        np.testing.assert_allclose(p(t, order)[:, 0], wanted, rtol=0.0, atol=1e-9 * 10**order)


@given(seeds)
def test_through_is_continuous_to_the_second_derivative(seed: int) -> None:
    rng = np.random.default_rng(seed)
    x = np.concatenate([[0.0], np.cumsum(rng.uniform(0.1, 1.0, 4))])
    p = quintic_through(x, *rng.normal(size=(3, 5, 2)))
    for order in range(3):
        d = p.derivative(order) if order else p
        first = d.c[-1, 1:]
        last = np.array([[np.polyval(d.c[:, k, j], x[k + 1] - x[k]) for j in range(2)] for k in range(3)])
        np.testing.assert_allclose(first, last, rtol=0.0, atol=1e-10)


def test_rest_to_rest_is_the_known_curve() -> None:
    zero = np.zeros((1, 1))
    p = quintic(np.array([0.0, 2.0]), (zero, zero, zero), (zero + 1.0, zero, zero))
    u = np.linspace(0.0, 1.0, 21)
    np.testing.assert_allclose(p(2.0 * u)[:, 0], 10 * u**3 - 15 * u**4 + 6 * u**5, rtol=0.0, atol=1e-14)
    assert p(1.0, 1)[0] == pytest.approx(15 / 8 / 2)
