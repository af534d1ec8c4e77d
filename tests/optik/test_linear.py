import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from optik.linear import cholesky_solve, damped_step, qr_factor, qr_solve, smallest_of_factor, smallest_singular_value
from tests.seeds import shift_seed


def factored(A):
    QR, beta, order = A.copy(), np.empty(A.shape[1]), np.empty(A.shape[1], np.int64)
    return QR, beta, order, qr_factor(QR, beta, order)


@pytest.mark.parametrize("shape", [(6, 4), (6, 5), (6, 6), (7, 7), (9, 9)])
def test_least_squares_are_numpys(shape):
    rng = np.random.default_rng(shape[1])
    for _ in range(50):
        A, b = rng.normal(size=shape), rng.normal(size=shape[0])
        QR, beta, order, _ = factored(A)
        x = np.empty(shape[1])
        rest = qr_solve(QR, beta, order, b.copy(), x)
        wanted = np.linalg.lstsq(A, b)[0]
        np.testing.assert_allclose(x, wanted, rtol=1e-10, atol=1e-10)
        assert rest == pytest.approx(np.linalg.norm(A @ wanted - b), abs=1e-12)


@pytest.mark.parametrize("shape", [(6, 4), (6, 6), (6, 7), (6, 9)])
@pytest.mark.parametrize("least", [1.0, 1e-3, 1e-7, 1e-12, 0.0])
def test_the_smallest_singular_value_is_numpys_however_small(shape, least):
    rng = np.random.default_rng(7)
    for _ in range(30):
        u, s, vt = np.linalg.svd(rng.normal(size=shape), full_matrices=False)
        s[-1] = least * s[0]
        if rng.random() < 0.3:
            s[-2] = s[-1]  # two that are equal
        J = (u * s) @ vt
        assert abs(smallest_singular_value(J) - np.linalg.svd(J, compute_uv=False)[-1]) < 1e-9 * s[0] * max(least, 1e-6)
        if shape[1] <= 6:
            QR, _, _, rank = factored(J)
            assert rank == 0.0 or abs(smallest_of_factor(QR) - s.min()) < 1e-9 * s[0] * max(least, 1e-6)


def test_a_lost_rank_shows_in_the_last_pivot():
    A = np.random.default_rng(1).normal(size=(6, 6))
    assert factored(A)[3] > 1e-4
    A[:, 2] = A[:, 4]
    assert factored(A)[3] < 1e-14
    A[:] = 0.0
    assert factored(A)[3] == 0.0
    assert factored(np.full((6, 6), np.nan))[3] == 0.0
    assert smallest_singular_value(np.zeros((6, 7))) == 0.0


@pytest.mark.parametrize("shape", [(6, 4), (6, 6), (6, 7), (6, 9)])
def test_above_a_floor_the_answer_is_a_lower_bound_above_it(shape):
    rng, cheap = np.random.default_rng(shift_seed(3)), 0
    for _ in range(200):
        J = rng.normal(size=shape) * 10.0 ** rng.uniform(-2, 1, shape[0])[:, None]
        true, floor = np.linalg.svd(J, compute_uv=False)[-1], 10.0 ** rng.uniform(-5, 0)
        found = smallest_singular_value(J, floor)
        if true <= floor:
            assert found == pytest.approx(true, rel=1e-8)
        else:
            assert floor < found <= true * (1.0 + 1e-8)
            cheap += found < 0.99 * true
    assert cheap > 20


@given(st.integers(1, 8), st.integers(0, 10**6), st.floats(0.01, 100))
def test_cholesky_solve_is_numpys_solve(n, seed, scale):
    rng = np.random.default_rng(seed)
    B = rng.normal(size=(n, n + 2))
    A, b = scale * (B @ B.T + 0.1 * np.eye(n)), rng.normal(size=n)
    x = b.copy()
    assert cholesky_solve(np.tril(A), x)  # the upper part is not read
    expected = np.linalg.solve(A, b)
    assert np.abs(x - expected).max() < 1e-12 * np.linalg.cond(A) * max(1.0, np.abs(expected).max())


@pytest.mark.parametrize(
    "A",
    [np.zeros((3, 3)), -np.eye(3), np.diag([1.0, 1.0, 0.0]), np.diag([1.0, -1.0, 1.0]), np.full((3, 3), np.nan)],
    ids=["zero", "negative", "rank two", "indefinite", "NaN"],
)
def test_cholesky_solve_refuses_what_is_not_positive_definite(A):
    assert not cholesky_solve(A.copy(), np.ones(3))


@given(st.integers(1, 8), st.integers(0, 10**6), st.floats(1e-3, 1.0))
def test_damped_step_is_equations_11_and_12(n, seed, damping):
    rng = np.random.default_rng(seed)
    J, e, dq = rng.normal(size=(6, n)), rng.normal(size=6), np.empty(n)
    assert damped_step(J, e, damping**2, np.empty((6, 6)), np.empty(6), dq)
    expected = np.linalg.solve(J.T @ J + damping**2 * np.eye(n), J.T @ e)  # the same by the other identity
    assert np.abs(dq - expected).max() < 1e-9 * max(1.0, np.abs(expected).max() / damping**2)


@given(st.integers(0, 10**6))
def test_a_step_without_damping_is_newtons(seed):
    rng = np.random.default_rng(seed)
    J, e, dq = rng.normal(size=(6, 6)) + 4 * np.eye(6), rng.normal(size=6), np.empty(6)
    assert damped_step(J, e, 0.0, np.empty((6, 6)), np.empty(6), dq)
    assert np.abs(dq - np.linalg.solve(J, e)).max() < 1e-14 * np.linalg.cond(J) ** 2
