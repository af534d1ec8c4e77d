"""Sine, cosine and arc tangent without branches, so that loops over lanes become vector instructions."""

from __future__ import annotations

import numpy as np

from optik.compiled import inlined
from optik.ik._lm.fma import fma


@inlined
def sine_cosine(x: float) -> tuple[float, float]:
    """Return sine and cosine to the last bits for |x| < 1e5, without branches (Cephes: Moshier 1989).

    Shapes and units: x [rad].
    """
    k = np.floor(x * 0.6366197723675814 + 0.5)
    r = fma(-k, 5.39030285815811905e-15, fma(-k, 7.54978941586159635335e-8, fma(-k, 1.57079625129699707031, x)))
    z = r * r
    s = fma(1.58962301576546568060e-10, z, -2.50507477628578072866e-8)
    s = fma(fma(s, z, 2.75573136213857245213e-6), z, -1.98412698295895385996e-4)
    s = fma(fma(s, z, 8.33333333332211858878e-3), z, -1.66666666666666307295e-1)
    s = fma(r * z, s, r)
    c = fma(-1.13585365213876817300e-11, z, 2.08757008419747316778e-9)
    c = fma(fma(c, z, -2.75573141792967388112e-7), z, 2.48015872888517045348e-5)
    c = fma(fma(c, z, -1.38888888888730564116e-3), z, 4.16666666666665929218e-2)
    c = fma(z * z, c, 1.0 - 0.5 * z)
    quadrant = k - 4.0 * np.floor(0.25 * k)
    odd = quadrant == 1.0 or quadrant == 3.0
    sine = c if odd else s
    cosine = s if odd else c
    return (-sine if quadrant >= 2.0 else sine), (-cosine if quadrant == 1.0 or quadrant == 2.0 else cosine)


@inlined
def angle_of(s: float, c: float) -> tuple[float, float]:
    """Return the angle of a sine s ≥ 0 and a cosine, 2 atan(s / (1 + |c|)) by a Chebyshev fit to 1e-13, and angle / s."""
    t = s / (1.0 + abs(c))
    z = t * t
    p = fma(-0.0001124208502549427, z, 0.001018151896826806)
    p = fma(fma(p, z, -0.004344250352224713), z, 0.01174565157426741)
    p = fma(fma(p, z, -0.02299373175968858), z, 0.03563559416944365)
    p = fma(fma(p, z, -0.04713014368368404), z, 0.05688636189885254)
    p = fma(fma(p, z, -0.06615557216560206), z, 0.07682487117587326)
    p = fma(fma(p, z, -0.09089586421532263), z, 0.1111099293745973)
    p = fma(fma(p, z, -0.1428570785015817), z, 0.1999999981481194)
    p = fma(fma(p, z, -0.3333333333121618), z, 0.9999999999999599)
    near = 2.0 * t * p
    angle = near if c >= 0.0 else 3.141592653589793 - near
    return angle, (2.0 * p / (1.0 + c) if c >= 0.0 else angle / max(s, 1e-300))
