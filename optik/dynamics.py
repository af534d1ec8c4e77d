"""Inverse dynamics of a serial arm and its time derivative, for one state or a batch.

Newton's and Euler's equations in the base frame (Luh, Walker and Paul 1980), differentiated once more in time. For link i with
angular velocity ω, angular acceleration α and its rate β, and for a vector d that is fixed in the link,

    d̈ = α × d + ω × (ω × d),        d⃛ = β × d + 2 α × (ω × d) + ω × (α × d) + ω × (ω × (ω × d)),

and for a tensor I that is fixed in it, d(I x)/dt = ω × I x + I (ẋ − ω × x). Callers add friction. Outputs are
written into the caller's arrays.
"""

from __future__ import annotations

import numpy as np

from optik.compiled import compiled, inlined
from optik.kinematics import Chain, Triple, axis_of, frames
from optik.types import Array

Bodies = tuple[Array, Array, Array, Array, Array]
"""The bodies of an arm as kernels take them: mass (n,) [kg], com (n, 3), the centres of mass in the joint frames [m], tensor
(n, 3, 3), the inertia about them in the axes of the joint frames [kg·m²], motor (n,), the motors' inertia reflected to the
joints [kg·m², kg], and gravity (3,) in the base frame [m/s²]."""


@inlined
def _cross(a: Triple, b: Triple) -> Triple:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inlined
def _plus(a: Triple, b: Triple) -> Triple:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@inlined
def _times(x: float, a: Triple) -> Triple:
    return x * a[0], x * a[1], x * a[2]


@inlined
def _row(x: Array, i: int) -> Triple:
    return x[i, 0], x[i, 1], x[i, 2]


@inlined
def _part(work: Array, what: int, i: int, column: int) -> Triple:
    return work[what, i, column, 0], work[what, i, column, 1], work[what, i, column, 2]


@inlined
def _keep(work: Array, what: int, i: int, column: int, a: Triple) -> None:
    work[what, i, column, 0], work[what, i, column, 1], work[what, i, column, 2] = a[0], a[1], a[2]


@inlined
def _put(x: Array, i: int, a: Triple) -> None:
    x[i, 0], x[i, 1], x[i, 2] = a[0], a[1], a[2]


@inlined
def _rotate(T: Array, i: int, a: Triple) -> Triple:
    """Return R_i a."""
    return (
        T[i, 0, 0] * a[0] + T[i, 0, 1] * a[1] + T[i, 0, 2] * a[2],
        T[i, 1, 0] * a[0] + T[i, 1, 1] * a[1] + T[i, 1, 2] * a[2],
        T[i, 2, 0] * a[0] + T[i, 2, 1] * a[1] + T[i, 2, 2] * a[2],
    )


@inlined
def _tensor(T: Array, tensor: Array, i: int, a: Triple) -> Triple:
    """Return R_i I_i R_iᵀ a."""
    x = T[i, 0, 0] * a[0] + T[i, 1, 0] * a[1] + T[i, 2, 0] * a[2]
    y = T[i, 0, 1] * a[0] + T[i, 1, 1] * a[1] + T[i, 2, 1] * a[2]
    z = T[i, 0, 2] * a[0] + T[i, 1, 2] * a[1] + T[i, 2, 2] * a[2]
    u = tensor[i, 0, 0] * x + tensor[i, 0, 1] * y + tensor[i, 0, 2] * z
    v = tensor[i, 1, 0] * x + tensor[i, 1, 1] * y + tensor[i, 1, 2] * z
    w = tensor[i, 2, 0] * x + tensor[i, 2, 1] * y + tensor[i, 2, 2] * z
    return _rotate(T, i, (u, v, w))


@inlined
def _product(A: Array, a: Triple) -> Triple:
    """Return A a for a matrix (3, 3)."""
    return (
        A[0, 0] * a[0] + A[0, 1] * a[1] + A[0, 2] * a[2],
        A[1, 0] * a[0] + A[1, 1] * a[1] + A[1, 2] * a[2],
        A[2, 0] * a[0] + A[2, 1] * a[1] + A[2, 2] * a[2],
    )


@inlined
def _second_derivative(w: Triple, a: Triple, d: Triple, wd: Triple) -> Triple:
    """Return d̈ of a vector d that is fixed in a link; wd is ω × d."""
    return _plus(_cross(a, d), _cross(w, wd))


@inlined
def _third_derivative(w: Triple, a: Triple, b: Triple, d: Triple, wd: Triple, second: Triple) -> Triple:
    """Return d⃛ of a vector d that is fixed in a link; wd is ω × d, second is d̈."""
    return _plus(_plus(_cross(b, d), _times(2.0, _cross(a, wd))), _cross(w, second))


@compiled
def _forces(chain: Chain, bodies: Bodies, weight: float, state: Array, work: Array) -> None:
    """Write the forces, moments and momenta of the links, from the base to the tool.

    Rows of ``work`` (7, n + 1, 4, 4) behind the joint frames, in the base frame, moments about the joint's origin: columns 0 of
    the 4 × 4 hold force, its rate, moment, its rate, the vector from the previous joint, its rate, the axis's rate; columns
    1 hold linear and angular momentum, mass times centre of mass, and the velocity of the joint's origin.
    """
    prismatic = chain[1]
    mass, com, tensor, _motor, gravity = bodies
    T = work[0]
    frames(chain, state[0], T[: mass.shape[0]])
    zero = (0.0, 0.0, 0.0)
    w, a, b, r, velocity, jerk = zero, zero, zero, zero, zero, zero
    acceleration = (-weight * gravity[0], -weight * gravity[1], -weight * gravity[2])
    for i in range(mass.shape[0]):
        z, p = (T[i, 0, 2], T[i, 1, 2], T[i, 2, 2]), (T[i, 0, 3], T[i, 1, 3], T[i, 2, 3])
        d = (p[0] - r[0], p[1] - r[1], p[2] - r[2])
        r, wd, wz = p, _cross(w, d), _cross(w, z)
        second = _second_derivative(w, a, d, wd)
        acceleration = _plus(acceleration, second)
        jerk = _plus(jerk, _third_derivative(w, a, b, d, wd, second))
        _keep(work, 5, i, 0, d)
        _keep(work, 7, i, 0, wz)
        j, factor = axis_of(chain, i)
        dq, ddq, dddq = factor * state[1, j], factor * state[2, j], factor * state[3, j]
        bend = _second_derivative(w, a, z, wz)  # z̈
        if prismatic[i]:
            acceleration = _plus(acceleration, _plus(_times(ddq, z), _times(2.0 * dq, wz)))
            jerk = _plus(jerk, _plus(_times(dddq, z), _plus(_times(3.0 * ddq, wz), _times(3.0 * dq, bend))))
            wd = _plus(wd, _times(dq, z))
        else:
            b = _plus(b, _plus(_times(dddq, z), _plus(_times(2.0 * ddq, wz), _times(dq, bend))))
            a = _plus(a, _plus(_times(ddq, z), _times(dq, wz)))
            w = _plus(w, _times(dq, z))
        velocity = _plus(velocity, wd)
        _keep(work, 6, i, 0, wd)
        _keep(work, 4, i, 1, velocity)
        c = _rotate(T, i, _row(com, i))
        wc = _cross(w, c)
        second = _second_derivative(w, a, c, wc)
        force = _times(mass[i], _plus(acceleration, second))
        change = _times(mass[i], _plus(jerk, _third_derivative(w, a, b, c, wc, second)))
        momentum = _times(mass[i], _plus(velocity, wc))
        spin, twist, wa = _tensor(T, tensor, i, w), _tensor(T, tensor, i, a), _cross(w, a)
        moment = _plus(twist, _cross(w, spin))
        rest = _tensor(T, tensor, i, (b[0] - wa[0], b[1] - wa[1], b[2] - wa[2]))
        turning = _plus(_plus(_cross(a, spin), _cross(w, _plus(moment, twist))), rest)
        _keep(work, 1, i, 0, force)
        _keep(work, 2, i, 0, change)
        _keep(work, 3, i, 0, _plus(moment, _cross(c, force)))
        _keep(work, 4, i, 0, _plus(turning, _plus(_cross(wc, force), _cross(c, change))))
        _keep(work, 1, i, 1, momentum)
        _keep(work, 2, i, 1, _plus(spin, _cross(c, momentum)))
        _keep(work, 3, i, 1, _times(mass[i], c))


@inlined
def _dot(a: Triple, b: Triple) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@compiled
def rigid_torques(chain: Chain, bodies: Bodies, weight: float, state: Array, work: Array, out: Array) -> None:
    """Write the torques of the rigid bodies and the motors' inertia, and their rates, at one state.

    Shapes and units: weight [1], state (4, n) [rad, rad/s, rad/s², rad/s³, or m], work (8, n + 1, 4, 4) [1], out (2, n)
    [N·m, N].
    """
    prismatic = chain[1]
    _mass, _com, _inertia, motor, _gravity = bodies
    n, T = motor.shape[0], work[0]
    if len(chain) == 4:
        out[:] = 0.0
    _forces(chain, bodies, weight, state, work)
    f, df, m, dm = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for i in range(n - 1, -1, -1):
        if i < n - 1:
            d, wd = _part(work, 5, i + 1, 0), _part(work, 6, i + 1, 0)
            m = _plus(m, _cross(d, f))
            dm = _plus(dm, _plus(_cross(wd, f), _cross(d, df)))
        f, df = _plus(f, _part(work, 1, i, 0)), _plus(df, _part(work, 2, i, 0))
        m, dm = _plus(m, _part(work, 3, i, 0)), _plus(dm, _part(work, 4, i, 0))
        z, dz = (T[i, 0, 2], T[i, 1, 2], T[i, 2, 2]), _part(work, 7, i, 0)
        e, de = (f, df) if prismatic[i] else (m, dm)
        j, factor = axis_of(chain, i)
        torque = _dot(z, e) + motor[i] * (factor * state[2, j])
        rate = _dot(z, de) + _dot(dz, e) + motor[i] * (factor * state[3, j])
        if len(chain) == 3:
            out[0, i], out[1, i] = torque, rate
        else:
            out[0, j] += factor * torque
            out[1, j] += factor * rate


@compiled
def torques_at(chain: Chain, bodies: Bodies, state: Array, work: Array, out: Array) -> None:
    """Write the torques of the rigid bodies and the motors' inertia at one state, without rates.

    Shapes and units: state (3, n) [rad, rad/s, rad/s², or m], work (4, n + 1, 4, 4) [1], out (n,) [N·m, N].
    """
    prismatic = chain[1]
    mass, com, tensor, motor, gravity = bodies
    n = motor.shape[0]
    if len(chain) == 4:
        out[:] = 0.0
    T = work[0]
    frames(chain, state[0], T[:n])
    F, N, D = work[1, :, 0], work[2, :, 0], work[3, :, 0]
    zero = (0.0, 0.0, 0.0)
    w, a, r = zero, zero, zero
    acceleration = (-gravity[0], -gravity[1], -gravity[2])
    for i in range(n):
        z, p = (T[i, 0, 2], T[i, 1, 2], T[i, 2, 2]), (T[i, 0, 3], T[i, 1, 3], T[i, 2, 3])
        d = (p[0] - r[0], p[1] - r[1], p[2] - r[2])
        r, wz = p, _cross(w, z)
        acceleration = _plus(acceleration, _second_derivative(w, a, d, _cross(w, d)))
        _put(D, i, d)
        j, factor = axis_of(chain, i)
        dq, ddq = factor * state[1, j], factor * state[2, j]
        if prismatic[i]:
            acceleration = _plus(acceleration, _plus(_times(ddq, z), _times(2.0 * dq, wz)))
        else:
            a = _plus(a, _plus(_times(ddq, z), _times(dq, wz)))
            w = _plus(w, _times(dq, z))
        c = _rotate(T, i, _row(com, i))
        force = _times(mass[i], _plus(acceleration, _second_derivative(w, a, c, _cross(w, c))))
        moment = _plus(_tensor(T, tensor, i, a), _cross(w, _tensor(T, tensor, i, w)))
        _put(F, i, force)
        _put(N, i, _plus(moment, _cross(c, force)))
    f, m = zero, zero
    for i in range(n - 1, -1, -1):
        if i < n - 1:
            m = _plus(m, _cross(_row(D, i + 1), f))
        f, m = _plus(f, _row(F, i)), _plus(m, _row(N, i))
        e = f if prismatic[i] else m
        j, factor = axis_of(chain, i)
        torque = T[i, 0, 2] * e[0] + T[i, 1, 2] * e[1] + T[i, 2, 2] * e[2] + motor[i] * (factor * state[2, j])
        out[j] = torque if len(chain) == 3 else out[j] + factor * torque


@compiled
def joint_torques(chain: Chain, bodies: Bodies, friction: tuple[Array, Array], states: Array, out: Array) -> None:
    """Write the torques at states, with viscous and Coulomb friction.

    Shapes and units: friction (n,) [N·m·s/rad, N·s/m], states (k, 3, n) [rad, rad/s, rad/s², or m], out (k, n) [N·m, N].
    """
    viscous, coulomb = friction
    n = viscous.shape[0]
    work = np.empty((4, chain[0].shape[0] + 1, 4, 4))
    for k in range(states.shape[0]):
        torques_at(chain, bodies, states[k], work, out[k])
        for i in range(n):
            speed = states[k, 1, i]
            out[k, i] += viscous[i] * speed + coulomb[i] * np.sign(speed)


@inlined
def _join(mass: float, centre: Array, about: Array, part: float, at: Triple) -> float:
    """Add a point mass to a body, given by its mass, centre of mass and inertia about it; return the mass of both."""
    both = mass + part
    if part > 0.0:
        share = part / both
        d = (at[0] - centre[0], at[1] - centre[1], at[2] - centre[2])
        reduced, square = mass * share, d[0] * d[0] + d[1] * d[1] + d[2] * d[2]
        for r in range(3):
            for c in range(3):
                about[r, c] -= reduced * d[r] * d[c]
            about[r, r] += reduced * square
            centre[r] += share * d[r]
    return both


@compiled
def mass_matrices(chain: Chain, bodies: Bodies, q: Array, out: Array) -> None:
    """Write the mass matrices, by composite bodies (Walker and Orin 1982), with the motors' inertia.

    Shapes and units: q (k, n) [rad, m], out (k, n, n) [kg·m², kg·m, kg].
    """
    prismatic = chain[1]
    mass, com, tensor, motor, _gravity = bodies
    n = mass.shape[0]
    if len(chain) == 4:
        out[:] = 0.0
    T, centre, about = np.empty((n, 4, 4)), np.empty(3), np.empty((3, 3))
    for k in range(q.shape[0]):
        frames(chain, q[k], T)
        whole = 0.0
        centre[:], about[:] = 0.0, 0.0
        for i in range(n - 1, -1, -1):
            c, R = _rotate(T, i, _row(com, i)), T[i, :3, :3]
            whole = _join(whole, centre, about, mass[i], (T[i, 0, 3] + c[0], T[i, 1, 3] + c[1], T[i, 2, 3] + c[2]))
            for column in range(3):
                x, y = 1.0 if column == 0 else 0.0, 1.0 if column == 1 else 0.0
                turned = _tensor(T, tensor, i, (x, y, 1.0 - x - y))
                about[0, column] += turned[0]
                about[1, column] += turned[1]
                about[2, column] += turned[2]
            z = (R[0, 2], R[1, 2], R[2, 2])
            d = (centre[0] - T[i, 0, 3], centre[1] - T[i, 1, 3], centre[2] - T[i, 2, 3])
            # momentum of the composite body at unit velocity of joint i, and its moment about the centre of mass
            push, spin = _times(whole, z if prismatic[i] else _cross(z, d)), (0.0, 0.0, 0.0)
            if not prismatic[i]:
                spin = _product(about, z)
            for j in range(i + 1):
                axis = (T[j, 0, 2], T[j, 1, 2], T[j, 2, 2])
                arm = (centre[0] - T[j, 0, 3], centre[1] - T[j, 1, 3], centre[2] - T[j, 2, 3])
                moved = push if prismatic[j] else _plus(spin, _cross(arm, push))
                value = axis[0] * moved[0] + axis[1] * moved[1] + axis[2] * moved[2]
                if len(chain) == 3:
                    out[k, i, j] = value
                    out[k, j, i] = out[k, i, j]
                else:
                    (row, a), (column, b) = axis_of(chain, i), axis_of(chain, j)
                    out[k, row, column] += a * b * value
                    if j < i:
                        out[k, column, row] += a * b * value
            row, a = axis_of(chain, i)
            out[k, row, row] += a * a * motor[i]


@compiled
def torques_batch(chain: Chain, bodies: Bodies, viscous: Array, states: Array, out: Array) -> None:
    """Write the torques with viscous and without Coulomb friction, and their rates, at states.

    Shapes and units: viscous (n,) [N·m·s/rad, N·s/m], states (k, 4, n) [rad, rad/s, rad/s², rad/s³, or m], out (k, 2, n)
    [N·m, N].
    """
    n = viscous.shape[0]
    work = np.empty((8, chain[0].shape[0] + 1, 4, 4))
    for k in range(states.shape[0]):
        rigid_torques(chain, bodies, 1.0, states[k], work, out[k])
        for i in range(n):
            out[k, 0, i] += viscous[i] * states[k, 1, i]
            out[k, 1, i] += viscous[i] * states[k, 2, i]


@compiled
def path_torques(chain: Chain, bodies: Bodies, path: Array, out: Array) -> None:
    """Write the coefficients of the rigid bodies' torques and their rates along a joint path q(s).

    With v = ṡ, a = s̈, j = s⃛ the torque is p a + c v² + g and its rate p j + d v a + c' v³ + g' v, where p = M q',
    c = M q'' + C(q, q') q', g is the torque of gravity, and d = p' + 2 c. On the motion s = t without gravity c is the torque
    and c' its rate; p is the momentum about (or along) each joint's axis of the links that the joint moves, whose angular
    momentum L about the joint's origin o changes by the moment of the forces less ȯ × their linear momentum; and g is the
    moment of their weight.

    Shapes and units: path (4, k, n) [as q over powers of s], out (k, 6, n) [as torque over powers of s].
    """
    prismatic = chain[1]
    mass, _com, _tensor, motor, gravity = bodies
    k, n = path.shape[1], mass.shape[0]
    work, state = np.empty((8, n + 1, 4, 4)), np.empty((4, path.shape[2]))
    if len(chain) == 4:
        out[:] = 0.0
    T, down = work[0], (gravity[0], gravity[1], gravity[2])
    for at in range(k):
        for order in range(4):
            for i in range(path.shape[2]):
                state[order, i] = path[order, at, i]
        _forces(chain, bodies, 0.0, state, work)
        zero = (0.0, 0.0, 0.0)
        f, df, m, dm, P, L, S, M = zero, zero, zero, zero, zero, zero, zero, 0.0
        for i in range(n - 1, -1, -1):
            if i < n - 1:
                d, wd = _part(work, 5, i + 1, 0), _part(work, 6, i + 1, 0)
                m = _plus(m, _cross(d, f))
                dm = _plus(dm, _plus(_cross(wd, f), _cross(d, df)))
                L, S = _plus(L, _cross(d, P)), _plus(S, _times(M, d))
            f, df = _plus(f, _part(work, 1, i, 0)), _plus(df, _part(work, 2, i, 0))
            m, dm = _plus(m, _part(work, 3, i, 0)), _plus(dm, _part(work, 4, i, 0))
            P, L = _plus(P, _part(work, 1, i, 1)), _plus(L, _part(work, 2, i, 1))
            S, M = _plus(S, _part(work, 3, i, 1)), M + mass[i]
            z, dz, do = (T[i, 0, 2], T[i, 1, 2], T[i, 2, 2]), _part(work, 7, i, 0), _part(work, 4, i, 1)
            moved = _plus(P, _times(-M, do))  # rate of S
            if prismatic[i]:
                p, dp, c, dc = _dot(z, P), _dot(dz, P) + _dot(z, f), _dot(z, f), _dot(z, df) + _dot(dz, f)
                g, dg = -M * _dot(z, down), -M * _dot(dz, down)
            else:
                p, dp = _dot(z, L), _dot(dz, L) + _dot(z, _plus(m, _cross(P, do)))
                c, dc = _dot(z, m), _dot(z, dm) + _dot(dz, m)
                g, dg = -_dot(z, _cross(S, down)), -_dot(dz, _cross(S, down)) - _dot(z, _cross(moved, down))
            j, factor = axis_of(chain, i)
            v, a, jerk = factor * state[1, j], factor * state[2, j], factor * state[3, j]
            p, dp = p + motor[i] * v, dp + motor[i] * a
            c, dc = c + motor[i] * a, dc + motor[i] * jerk
            value = (p, c, g, dp + 2.0 * c, dc, dg)
            for order in range(6):
                out[at, order, j] = value[order] if len(chain) == 3 else out[at, order, j] + factor * value[order]
