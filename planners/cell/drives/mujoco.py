"""MujocoDrive: an arm with masses, motors and friction, simulated by MuJoCo with position servos of limited torque."""

from __future__ import annotations

from dataclasses import replace
from math import pi
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from optik.arm.inertia import Payload
from optik.arm.mjcf_writer import PLANT_STEP, assume_masses, import_mujoco, mujoco_model
from optik.arm.robot import Robot
from optik.check import check_flag
from optik.compiled import compiled
from optik.dynamics import joint_torques, mass_matrices
from optik.errors import InvalidInput
from optik.types import Array, Flags
from planners.cell.drives._run import Commands, DriveRun, Steps
from planners.cell.drives._simulated import SimulatedDrive
from planners.cell.drives.base import Execution, by_joint

# ---------------- servos of limited torque


BANDWIDTH = 10.0
"""Default natural frequency of the servos [Hz]: position loops of industrial arms are below the first resonance of their
gears, some 10 to 20 Hz."""

DAMPING = 1.0
"""Default damping ratio of the servos [1]: without the velocity filter there is no overshoot."""

FILTER_TIME = 0.25
"""Time constant of the velocity filter times the natural frequency in rad/s [1]: 4 ms at 10 Hz. A larger one makes the loop
ring (the damping ratio of its fast part is 0.65), a smaller one makes the motors follow the counts of the encoders."""

FASTEST_GAIN = 1.0
"""Largest velocity gain, and natural frequency in rad/s, times the step of the plant [1]: with a larger one a servo
overcorrects in one step, and motors oscillate between their limits (from 160 Hz at 0.5 ms)."""

EXAMINED = 20
"""Number of random configurations at which the inertia of every joint is checked."""

FULL_TURN = pi
"""Largest absolute position of the sampled configurations [rad, m]: joints without limits repeat after a turn."""


class Gains(NamedTuple):
    """The gains (n,) of the servos: accelerations per error; the mass matrix times these accelerations is the torque."""

    frequency: Array  # natural frequency ω [rad/s]; its square is the position gain [1/s²]
    damping: Array  # velocity gain 2 ζ ω [1/s]
    filter: Array  # time constant of the velocity filter [s]


def compute_gains(robot: Robot, bandwidth: ArrayLike, damping: ArrayLike) -> Gains:
    """Return the gains with which the error of every joint decays as that of a mass with a spring and a damper."""
    _check_inertia(robot)
    w = 2.0 * pi * by_joint(robot, bandwidth, "bandwidth")
    return Gains(w, 2.0 * w * by_joint(robot, damping, "damping"), FILTER_TIME / w)


def check_step(gains: Gains, step: float) -> None:
    """Raise InvalidInput if the servos are too fast for the step of the plant."""
    fastest = float(np.maximum(gains.frequency, gains.damping).max())
    if fastest * step > FASTEST_GAIN:
        wanted = f"gains of at most {FASTEST_GAIN / step:.0f} 1/s at steps of {1000.0 * step:g} ms, or a smaller step"
        raise InvalidInput("bandwidth, damping", f"a gain (ω, 2 ζ ω) of {fastest:.0f} 1/s", wanted)


def _check_inertia(robot: Robot) -> None:
    """Raise InvalidInput if a joint moves no mass."""
    low, high = np.maximum(robot.limits.lower, -FULL_TURN), np.minimum(robot.limits.upper, FULL_TURN)
    low, high = np.minimum(low, high), np.maximum(low, high)  # limits that begin beyond a turn
    M = robot.mass_matrix(np.random.default_rng(0).uniform(low, high, (EXAMINED, robot.n)))
    if not (np.linalg.eigvalsh(M) > 0.0).all():
        inertia = np.diagonal(M, axis1=1, axis2=2).max(axis=0)
        joint = robot.joint_names[int(inertia.argmin())]
        raise InvalidInput(
            "robot", f"{robot.name!r}, whose joint {joint} moves no mass", "masses, or inertia of the motors"
        )


POSITION_GAIN, VELOCITY_GAIN, NEW_WEIGHT, COUNT, FARTHEST_OFF, MOST_TORQUE = range(6)
"""Rows of the parameters of `servo`: position gain [1/s²], velocity gain [1/s], weight of a new difference in the filtered
velocity [1], resolution of the encoder [rad, m] (0 for an exact one), position error at which the motor is switched off
[rad, m], and largest torque [N·m, N]."""


def pack_gains(gains: Gains, step: float, resolution: Array, following: Array, most: Array) -> Array:
    """Return the parameters of `servo` in one array, because each array costs 0.2 µs at every step."""
    weight = step / (gains.filter + step)
    return np.array([gains.frequency**2, gains.damping, weight, resolution, following, most])


@compiled
def servo(tuned: Array, M: Array, setpoint: Array, position: Array, state: Array, step: float, torque: Array) -> None:
    """Compute the torques of the motors for one step of the plant.

    The measured velocity is the difference of two encoder readings over the step. The difference of commanded and measured
    velocity is filtered. A motor is switched off for good when its joint is too far from its set-point.

    Shapes and units (revolute joints): tuned (6, n), M (n, n) [kg·m²], setpoint (3, n) [rad, rad/s, N·m], position (n,) [rad],
    state (4, n) [rad, rad/s, 1, rad/s²], step [s], torque (n,) [N·m] (overwritten).
    """
    n = position.size
    for i in range(n):
        counts = tuned[COUNT, i]
        read = np.round(position[i] / counts) * counts if counts > 0.0 else position[i]
        state[3, i] = 0.0
        if read == read:  # no NaN
            difference = setpoint[1, i] - (read - state[0, i]) / step
            if difference != difference:  # the encoder is back
                difference = 0.0
            state[1, i] += tuned[NEW_WEIGHT, i] * (difference - state[1, i])
            if abs(setpoint[0, i] - read) > tuned[FARTHEST_OFF, i]:
                state[2, i] = 1.0
            if state[2, i] == 0.0:
                error = setpoint[0, i] - read
                state[3, i] = tuned[POSITION_GAIN, i] * error + tuned[VELOCITY_GAIN, i] * state[1, i]
        else:
            state[1, i] = 0.0
        state[0, i] = read
    for i in range(n):
        wanted, most = setpoint[2, i], tuned[MOST_TORQUE, i]
        for j in range(n):
            wanted += M[i, j] * state[3, j]
        torque[i] = min(max(wanted, -most), most) if state[2, i] == 0.0 else 0.0


# ---------------- the drive


CREEP = 1e-5
"""Velocity scale of the tanh that smooths the feed-forward of Coulomb friction [rad/s, m/s]: the velocity of a joint at rest
is rounding, and its sign means nothing. A scale ten times larger costs 1e-4 rad in a motion of 12 s."""

BLOCKED = 1e6
"""Coulomb friction of a blocked joint, and of the brake of a joint without a torque limit [N·m, N]."""

SETTLED = 10.0
"""Time for which the last set-point is held, in time constants of the slowest servo [1]: an error decays to 5e-4 of itself."""

DIVERGED = 1e6
"""Velocity of a joint above which the simulation has diverged [rad/s, m/s]: no motor turns so fast."""

SAG = (0.03, 0.003)
"""Default of the largest distance of the arm from a plan's start or end without feed-forward [rad, m]: under gravity the error
of such servos is the acceleration of the free fall over ω², up to 0.024 rad for the arms of this library at 10 Hz."""


class MujocoDrive(SimulatedDrive):
    """An arm in MuJoCo with a position servo at each joint.

    At each step of the plant the torques of the motors are M (ω² (q_set − q_enc) + 2 ζ ω (q̇_set − q̇_enc)) + τ_ff, within
    the torque limits. M is the mass matrix at the set-point at the start of the period, so that every joint has the natural
    frequency ω and the damping ratio ζ in every configuration. q_enc are the encoder readings, q̇_enc their differences over
    the step (the velocity of the set-point is also taken half a step earlier). The difference of velocities is filtered.
    τ_ff is `Robot.torques` at the interpolated set-point: position, velocity and acceleration of the cubic through the
    set-points' positions and velocities. Its Coulomb friction has the sign of the set-point's velocity.

    A joint with a lost encoder is driven by τ_ff alone; its brake is applied at rest. A joint that is farther from its
    set-point than `following` is braked at once. Brakes are as strong as the motor.

    Parameters
    ----------
    robot : Robot
        The arm of the plans; τ_ff and the gains are computed from it. An arm without masses gets assumed ones and no torque
        limits. Of a payload whose mass is an interval, the middle is used.
    q : (n,) array, optional
        Initial configuration [rad, m]; by default the start of the first plan.
    plant : Robot, optional
        The true arm: the same kinematics with other masses, friction or payload. By default the robot itself, with
        the heaviest payload.
    feedforward : bool
        Whether τ_ff acts.
    bandwidth : scalar or (n,) array
        Natural frequency of the servos, ω / 2π [Hz].
    damping : scalar or (n,) array
        Damping ratio ζ of the servos [1].
    step : float
        Largest step of MuJoCo [s]; the period is a whole number of steps.
    seed : int
        Seed of the encoder noise.
    **others
        Options of every simulated drive. Without feed-forward, the default of ``start_tolerance`` and ``end_tolerance`` is
        0.03 rad and 3 mm.

    Raises
    ------
    InvalidInput
        An argument out of range, a step above 0.5 ms, servos that are too fast for it, a plant with other kinematics or
        without masses, a joint that moves no mass; during an execution, servos that are not stable on the plant.
    MissingDependency
        MuJoCo is not installed.
    """

    name: ClassVar[str] = "mujoco"
    plant: Robot
    gains: Gains

    def __init__(
        self, robot: Robot, q: ArrayLike | None = None, *, plant: Robot | None = None, feedforward: bool = True,
        bandwidth: ArrayLike = BANDWIDTH, damping: ArrayLike = DAMPING,
        step: float = PLANT_STEP, seed: int = 0, **others: Any,
    ) -> None:  # fmt: skip
        self._mujoco = import_mujoco("the drive 'mujoco'")
        self.feedforward = check_flag(feedforward, "feedforward")
        if not feedforward and isinstance(robot, Robot):
            sag = np.where(robot.prismatic, *reversed(SAG))
            others = {"start_tolerance": sag, "end_tolerance": sag, **others}
        super().__init__(robot, step=step, seed=seed, **others)
        if step > PLANT_STEP:
            raise InvalidInput(
                "step", f"{step:g} s", f"at most {PLANT_STEP:g} s, so that friction and servos are simulated accurately"
            )
        self._servo_options = bandwidth, damping
        self._build(robot, plant)
        if q is not None:
            self._put(q)

    def carry(self, robot: Robot) -> None:
        """Change tool, payload and shapes of the arm at rest; see `Drive.carry`.

        A given plant carries the same load; the ratio of its payload mass to the robot's does not change.
        """
        before = self.robot
        super().carry(robot)
        plant = None if self._given is None else _with_load_of(self._given, before, robot)
        here = self._actual() if self._placed else None
        self._build(robot, plant)
        if here is not None:
            self._place(here)

    # ------------------------------------------------------------ the plant

    def _build(self, robot: Robot, plant: Robot | None) -> None:
        """Build the model of the servos and the plant."""
        heavy, self._assumed = assume_masses(robot)
        self._given = plant
        self.plant = _check_plant(heavy, plant, known=not self._assumed)
        model = _with_one_mass(heavy, middle=True)
        assert model.inertia is not None and self.plant.inertia is not None
        self.gains = compute_gains(model, *self._servo_options)
        self.settling = SETTLED / float(self.gains.frequency.min())
        self._chain, self._load = model.chain, model.loads[0]
        self._M = np.empty((1, robot.n, robot.n))
        self._friction = np.array(self.plant.inertia.coulomb)
        self._most = np.minimum(_torque_limits(model), _torque_limits(self.plant))
        self._step = self.period / self.steps
        check_step(self.gains, self._step)
        self._tuned = pack_gains(self.gains, self._step, self.options.resolution, self.options.following, self._most)
        self._braked = False  # whether a joint has the friction of a brake, or of a blocked joint
        self._model = mujoco_model(self.plant, step=self._step)
        self._data = self._mujoco.MjData(self._model)

    def _place(self, q: Array) -> None:
        self._mujoco.mj_resetData(self._model, self._data)
        self._data.qpos[:] = q
        self._state = np.zeros((4, q.size))
        self._state[0] = q
        self._now = (
            self._feed_forward(q[None], 0.0 * q[None], 0.0 * q[None])[0] if self.feedforward else np.zeros(q.size)
        )

    def _actual(self) -> Array:
        return np.array(self._data.qpos)

    def _torque(self) -> Array:
        return self._now

    def _advance(self, commands: Commands, stalled: Flags) -> Steps:
        data, m, n = self._data, self.steps, self.robot.n
        true = np.array(data.qpos)
        instead = self._misread(true)
        false, lost = instead != true, np.isnan(instead)
        self._brake(commands, stalled, lost)
        rows = np.empty((m, 3, n))
        rows[:, 0], rows[:, 1] = commands.q[:-1], commands.dq[:-1] - 0.5 * self._step * commands.ddq[:-1]
        rows[:, 2] = self._feed_forward(commands.q[:-1], commands.dq[:-1], commands.ddq[:-1])
        if not self.feedforward:
            rows[:, 2, ~lost] = 0.0
        off = (
            np.zeros((m, n)) if self.options.noise == 0.0 else self.options.noise * self._noise.standard_normal((m, n))
        )
        clean = self.options.noise == 0.0 and not false.any()
        mass_matrices(self._chain, self._load.bodies, commands.q[:1], self._M)
        q, dq, torque = np.empty((3, m, n))
        M, tuned, state, h, at, motors = self._M[0], self._tuned, self._state, self._step, data.qpos, data.ctrl
        for j, row in enumerate(rows):
            read = at if clean else np.where(false, instead, at + off[j])
            servo(tuned, M, row, read, state, h, motors)
            self._mujoco.mj_step(self._model, data)
            q[j], dq[j], torque[j] = at, data.qvel, motors
        if data.warning.number.any() or np.abs(dq).max() > DIVERGED:  # MuJoCo would put the arm back to zero
            wanted = f"servos that are stable on this plant at steps of {1000.0 * h:g} ms"
            raise InvalidInput("bandwidth, damping, plant", "a simulation that diverged", wanted)
        self._now = torque[-1].copy()
        return Steps(q, dq, torque)

    def _brake(self, commands: Commands, stalled: Flags, lost: Flags) -> None:
        """Set each joint's friction torque: its own, the brake's, or that of a blocked joint."""
        self._state[2, lost & ~commands.dq.any(axis=0)] = 1.0
        if self._stuck is not None:
            self._state[2, self._stuck] = 1.0
        off = self._state[2] > 0.0
        braked = off | stalled
        if not braked.any() and not self._braked:
            return
        self._braked = bool(braked.any())
        brakes = np.where(np.isfinite(self._most), self._most, BLOCKED)
        friction = np.where(off, np.maximum(brakes, self._friction), self._friction)
        self._model.dof_frictionloss[:] = np.where(stalled, BLOCKED, friction)

    def _feed_forward(self, q: Array, dq: Array, ddq: Array) -> Array:
        """Return the torques of the model at set-points, with smoothed Coulomb friction."""
        torque, smooth = np.empty_like(q), (self._load.viscous, np.zeros(q.shape[1]))
        joint_torques(self._chain, self._load.bodies, smooth, np.stack([q, dq, ddq], axis=1), torque)
        return torque + self._load.coulomb * np.tanh(dq / CREEP)

    def _put_brakes_on(self) -> None:
        self._state[2] = 1.0

    # ------------------------------------------------------------ the report

    def _remarks(self) -> tuple[str, ...]:
        remarks = [self._assumed] if self._assumed else []
        payload = self.robot.payload
        if payload is not None and len(payload.masses) > 1:
            known = f"the servos' model carries the middle of {payload}"
            remarks.append(f"{known}; the simulated arm carries {self.plant.payload}")
        return tuple(remarks)

    def _report(self, run: DriveRun) -> Execution:
        torque = np.abs(np.concatenate(run.torque)) if run.torque else np.zeros((0, self.robot.n))
        for i in np.flatnonzero((torque >= self._most).any(axis=0)):
            for_long = self._step * int((torque[:, i] >= self._most[i]).sum())
            run.notes.append(
                f"the motor of {self.robot.joint_names[i]} was at its torque limit for {1000.0 * for_long:.4g} ms"
            )
        return super()._report(run)


# ---------------------------------------------------------------- arms


def _check_plant(robot: Robot, plant: Robot | None, *, known: bool) -> Robot:
    """Return the simulated arm with masses and one payload; its masses may be unknown only if the robot's are."""
    if plant is None:
        return _with_one_mass(robot, middle=False)
    wanted = f"a Robot with masses and the joints of {robot.name!r}; masses, friction and payload may differ"
    if not isinstance(plant, Robot) or (known and plant.inertia is None):
        raise InvalidInput("plant", repr(plant)[:60], wanted)
    same = plant.n == robot.n and np.array_equal(plant.fixed, robot.fixed)
    if not same or not np.array_equal(plant.prismatic, robot.prismatic):
        raise InvalidInput("plant", f"{plant.name!r}, which has other joints", wanted)
    return _with_one_mass(assume_masses(plant)[0], middle=False)


def _torque_limits(robot: Robot) -> Array:
    """Return the torque limits (n,) [N·m, N]; infinite where unknown."""
    known = robot.limits.torque
    return np.full(robot.n, np.inf) if known is None else np.broadcast_to(known, (robot.n,)).astype(float)


def _with_one_mass(robot: Robot, *, middle: bool) -> Robot:
    """Return the arm with the middle or the heaviest payload if its mass is an interval."""
    payload = robot.payload
    if payload is None or len(payload.masses) == 1:
        return robot
    mass = float(np.mean(payload.masses)) if middle else payload.masses[-1]
    return replace(robot, payload=Payload(mass, payload.com, payload.inertia * (mass / payload.masses[-1])))


def _with_load_of(plant: Robot, before: Robot, now: Robot) -> Robot:
    """Return the plant with the present payload of the robot, scaled by the same factor as its payload before."""
    old, new = before.payload, now.payload
    factor = plant.payload.masses[-1] / old.masses[-1] if plant.payload and old else 1.0
    plant = plant.with_payload(None).with_tool(now.tool)
    if new is None:
        return plant
    masses = tuple(factor * mass for mass in new.masses)
    mass = masses if len(masses) == 2 else masses[0]
    return replace(plant, payload=Payload(mass, new.com, factor * new.inertia))


METHOD = MujocoDrive
