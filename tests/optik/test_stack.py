"""Arrays on the stack of compiled code: as long as asked for, apart from each other, each call's own, constants only."""

import numba
import numpy as np
import pytest

from optik.ik._lm.lanes import stack


@numba.njit
def fill(scale, out):
    """Write three arrays one after the other, then read all back."""
    a, b, c = stack(3, 4), stack(1, 7), stack(3, 4)
    for i in range(3):
        for j in range(4):
            a[i, j] = scale * (10 * i + j)
            c[i, j] = -a[i, j]
    for j in range(7):
        b[0, j] = scale + j
    out[:12] = a.ravel()
    out[12:19] = b[0]
    out[19:31] = c.ravel()
    out[31], out[32], out[33], out[34] = a.shape[0], a.shape[1], b.shape[1], a.size


def test_arrays_have_their_shape_and_stand_apart():
    for scale in (1.0, 2.5):
        out = np.full(35, np.nan)
        fill(scale, out)
        a = scale * np.add.outer(10.0 * np.arange(3), np.arange(4)).ravel()
        assert (out[:12] == a).all()
        assert (out[12:19] == scale + np.arange(7)).all()
        assert (out[19:31] == -a).all()
        assert out[31:].tolist() == [3, 4, 7, 12]


@numba.njit
def nested(k, out):
    """Call itself while its own array is in use."""
    mine = stack(1, 2)
    mine[0, 0], mine[0, 1] = k, 2 * k
    if k > 0:
        nested(k - 1, out)
    out[k, 0], out[k, 1] = mine[0, 0], mine[0, 1]


def test_every_call_has_its_own():
    out = np.empty((6, 2))
    nested(5, out)
    assert (out == np.array([[k, 2 * k] for k in range(6)])).all()


@numba.njit
def rows(i):
    w = stack(4, 5)
    flat = w.reshape(20)
    for k in range(20):
        flat[k] = k
    row = w[i]
    return row.sum() + w[i, 4], w[1:3].sum(), w.flags.c_contiguous


def test_rows_and_slices_are_those_of_any_array():
    total, middle, contiguous = rows(2)
    assert (total, middle, contiguous) == (10 + 11 + 12 + 13 + 14 + 14, sum(range(5, 15)), True)


def test_a_size_known_only_at_run_time_is_refused_when_compiled():
    @numba.njit
    def wrong(n):
        return stack(n, 3)[0, 0]

    with pytest.raises(numba.TypingError):
        wrong(4)
