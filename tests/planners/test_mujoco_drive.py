"""The simulated arm under position servos: what it does with the set-points of a plan, against closed forms and the plan."""

import sys

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import optik
from optik.arm.inertia import Inertia
from optik.errors import InvalidInput, MissingDependency
from planners import plan
from planners.cell import MujocoDrive, make_drive
from planners.cell.drives._run import Commands
from planners.cell.drives.mujoco import NEW_WEIGHT, POSITION_GAIN, VELOCITY_GAIN, compute_gains, pack_gains, servo
from planners.timing import make_law
from tests.planners.faulty import FaultyMujoco, LostEncoder, Stall
from tests.seeds import shift_seed

START = np.deg2rad([20.0, -35.0, 40.0, 25.0, 50.0, -30.0])
SHIFT = np.array([-0.12, 0.0, 0.20])


def line(robot, timing="optimal", **options):
    """The project's default line."""
    goal = robot.fk(START).copy()
    goal[:3, 3] += SHIFT
    return plan(robot, goal, START, timing=timing, **options)


@pytest.fixture(scope="module")
def usual():
    found = line(optik.load("paper6r"))
    assert found
    return found


def errors(execution):
    """Difference of the arm from the continuous plan at every step of the plant (m, n)."""
    motion = execution.motion
    return execution.q - motion(np.minimum(execution.t, motion.duration))


def torque_ratios(execution):
    """Largest torques over the limits, and the certificate's bounds on them."""
    limits = execution.robot.limits.torque
    return np.abs(execution.torque).max(axis=0) / limits, execution.plan.certificate.torque.ratio


# ---------------------------------------------------------------- the default line
def test_interpolated_set_points_with_feed_forward_keep_the_plan_and_the_certificates_torque(usual):
    drive = make_drive("mujoco", usual.robot)
    done = drive.execute(usual)
    assert done and done.drive == "mujoco" and done.notes == ()
    assert np.allclose(np.diff(done.t), 0.0005, rtol=0, atol=1e-12)
    assert done.t[-1] >= usual.trajectory.duration
    assert np.abs(errors(done)).max() <= 2e-5  # asked for: 1e-4
    ratio, bound = torque_ratios(done)
    assert (ratio <= 1.05 * bound).all()
    assert (ratio >= 0.9 * bound).all()  # the bound is of this motion
    assert np.abs(done.dq[-1]).max() <= 1e-6
    assert np.abs(drive.measure() - usual.trajectory(usual.trajectory.duration)).max() <= 1e-5


def test_held_set_points_lag_by_half_a_period_so_the_error_falls_with_it(usual):
    worst = {}
    for period in (0.004, 0.002, 0.001):
        done = MujocoDrive(usual.robot, hold=True, period=period).execute(usual)
        off = errors(done)
        v = done.motion(np.minimum(done.t, done.motion.duration), 1)
        # A held set-point is old by half a period on average, and the servo acts on it at steps of 0.5 ms.
        assert np.isclose(-(off * v).sum() / (v * v).sum(), (period - 0.0005) / 2, rtol=0.02)
        worst[period] = np.abs(off).max()
    assert np.isclose(worst[0.004] / worst[0.002], 3.5 / 1.5, rtol=0.02)
    assert np.isclose(worst[0.002] / worst[0.001], 1.5 / 0.5, rtol=0.02)


def test_an_arm_at_rest_holds_its_place_against_gravity(usual):
    drive = MujocoDrive(usual.robot.with_inertia(coulomb=0.0).with_payload(3.0))
    drive.settling = 2.0
    found = line(drive.robot)
    done = drive.execute(found)
    late = done.q[done.t >= found.trajectory.duration + 0.5]
    assert len(late) > 2000
    assert np.abs(late - found.trajectory(found.trajectory.duration)).max() <= 7e-6  # about one count
    assert np.abs(late[-1000:].mean(axis=0) - late[:1000].mean(axis=0)).max() <= 1e-6


def test_the_papers_quintic_asks_for_more_than_the_motors_have(usual):
    found = line(usual.robot, make_law("quintic"))
    done = MujocoDrive(usual.robot).execute(found)
    limits = usual.robot.limits.torque
    assert done and np.abs(done.torque).max(axis=0)[0] == limits[0]
    assert any("joint1 was at its torque limit" in note for note in done.notes)
    assert np.abs(errors(done)).max() >= 1e-4  # five times what the shortest motion within the limits costs, at least


def test_another_plant_costs_accuracy_and_not_the_motion(usual):
    robot = usual.robot.with_payload(2.0)
    found, friction = line(robot), robot.inertia.coulomb
    plant = robot.with_inertia(coulomb=1.1 * friction, viscous=0.9 * robot.inertia.viscous).with_payload(2.1)
    nominal, other = (np.abs(errors(MujocoDrive(robot, plant=p).execute(found))).max() for p in (None, plant))
    assert nominal <= 2e-5
    # What friction is off, over inertia times ω²: the error of a servo at its softest.
    w = 2.0 * np.pi * 10.0
    soft = 0.1 * friction / (np.diagonal(robot.mass_matrix(START)) * w**2)
    assert 5.0 * nominal <= other <= 2.0 * soft.max()


# ---------------------------------------------------------------- closed forms
def pendulum(**inertia):
    """A point mass of 2 kg, half a metre from a horizontal axis, and a motor's inertia."""
    limits = optik.JointLimits([-3.0], [3.0], velocity=[3.0], acceleration=[20.0], jerk=[200.0])
    given = Inertia([2.0], [[0.5, 0.0, 0.0]], np.zeros((1, 3, 3)), motor=0.1, **inertia)
    return optik.Robot("pendulum", np.eye(4)[None], [False], np.eye(4), limits, gravity=(0, -1, 0), inertia=given)


def held(drive, q, periods):
    """The arm while a set-point is held."""
    at = np.full((drive.steps + 1, 1), q)
    asked = Commands(np.linspace(0.0, drive.period, drive.steps + 1), at, 0.0 * at, 0.0 * at)
    return np.concatenate([drive._advance(asked, np.zeros(1, dtype=bool)).q[:, 0] for _ in range(periods)])


def test_the_servo_moves_a_pendulum_as_its_differential_equation_says():
    drive = MujocoDrive(pendulum(viscous=0.2), [0.3], feedforward=False, encoder=np.inf, step=0.000125, following=1.0)
    q, set_at = held(drive, 0.32, 60), 0.32
    w, inertia, weight = 2.0 * np.pi * 10.0, 2.0 * 0.25 + 0.1, 2.0 * 9.80665 * 0.5

    def rates(t, x):  # angle, velocity, filtered velocity
        push = inertia * (w**2 * (set_at - x[0]) - 2.0 * w * x[2])
        return [x[1], (push - 0.2 * x[1] - weight * np.cos(x[0])) / inertia, (x[1] - x[2]) * w / 0.25]

    t = np.arange(1, len(q) + 1) * 0.000125
    expected = solve_ivp(rates, (0.0, t[-1]), [0.3, 0.0, 0.0], t_eval=t, rtol=1e-9, atol=1e-12).y[0]
    assert np.abs(q - expected).max() <= 2e-4 * np.ptp(expected) + 5e-5
    assert q.max() - q.min() > 0.01


def test_without_feed_forward_the_arm_sags_by_its_weight_over_the_servos_stiffness():
    drive = MujocoDrive(pendulum(), [0.3], feedforward=False, encoder=np.inf)
    q = held(drive, 0.3, 500)[-1]
    stiffness = 0.6 * (2.0 * np.pi * 10.0) ** 2
    assert np.isclose(stiffness * (0.3 - q), 2.0 * 9.80665 * 0.5 * np.cos(q), rtol=1e-6)
    stiff = MujocoDrive(pendulum(), [0.3], feedforward=False, encoder=np.inf, bandwidth=20.0)
    assert np.isclose((0.3 - held(stiff, 0.3, 500)[-1]) / (0.3 - q), 0.25, rtol=1e-3)


def test_with_feed_forward_the_arm_does_not_sag_and_friction_does_not_shake_it():
    for friction in (0.0, 1.0):
        drive = MujocoDrive(pendulum(coulomb=friction), [0.3], encoder=np.inf)
        assert np.abs(held(drive, 0.3, 100) - 0.3).max() <= 1e-9


# ---------------------------------------------------------------- encoders and faults
def test_coarse_encoders_cost_accuracy(usual):
    found = [MujocoDrive(usual.robot, encoder=counts).execute(usual) for counts in (np.inf, 2.0**14)]
    fine, coarse = (np.abs(errors(x)).max() for x in found)
    assert coarse >= 5.0 * fine and coarse <= 2.0 * 2.0 * np.pi / 2**14
    steps = found[1].measured / (2.0 * np.pi / 2**14)
    assert np.allclose(steps, np.round(steps), atol=1e-6)
    noisy = MujocoDrive(usual.robot, encoder_noise=1e-4, seed=3).execute(usual)
    again = MujocoDrive(usual.robot, encoder_noise=1e-4, seed=3).execute(usual)
    assert np.array_equal(noisy.q, again.q) and np.abs(errors(noisy)).max() >= 5.0 * fine


def test_a_blocked_joint_stands_still_and_the_arm_can_go_on(usual):
    drive = FaultyMujoco(usual.robot, faults=(Stall("joint1", 0.2, 0.6),))
    done = drive.execute(usual)
    assert done.fault is not None and done.fault.joint == "joint1"
    stands = done.q[(done.t > 0.21) & (done.t < 0.6), 0]
    assert np.ptp(stands) <= 1e-5
    # The servo gave up when the joint was too far off: after the block it does not leap to its set-point.
    assert np.ptp(done.q[done.t > 0.21, 0]) <= 1e-4
    assert np.abs(errors(done))[:, 1:].max() <= 1e-2  # the shock moves the other joints a little
    again = drive.resume(done)
    assert again and np.abs(drive.measure() - usual.trajectory(usual.trajectory.duration)).max() <= 1e-4


@pytest.mark.parametrize("feedforward", [True, pytest.param(False, marks=pytest.mark.soak)])
def test_a_joint_with_a_lost_encoder_goes_on_by_the_model_and_is_braked_at_rest(usual, feedforward):
    drive = FaultyMujoco(usual.robot, feedforward=feedforward, faults=(LostEncoder("joint2", 0.2),))
    done = drive.execute(usual)
    assert done.fault is not None and done.fault.joint == "joint2"
    assert np.abs(errors(done)).max() <= (1e-4 if feedforward else 1e-2)
    assert np.abs(done.dq[-1]).max() <= 1e-3


def test_a_joint_without_encoder_is_braked_at_rest_though_its_weight_is_unknown():
    plant = pendulum().with_inertia(mass=[3.0])
    for disturbances, moved in (((), (1e-4, 1.0)), ((LostEncoder("joint1", 0.0),), (0.0, 1e-5))):
        drive = FaultyMujoco(pendulum(), [0.3], plant=plant, faults=disturbances, following=1.0)
        assert moved[0] <= np.abs(held(drive, 0.3, 100) - 0.3).max() <= moved[1]


def test_a_servo_goes_on_with_the_first_reading_of_an_encoder_that_returns():
    rng = np.random.default_rng(6)
    tuned = pack_gains(compute_gains(optik.load("paper6r"), 10.0, 1.0), 5e-4, np.zeros(6), np.ones(6), np.full(6, 1e9))
    M, asked, state, torque = np.eye(6), rng.normal(size=(3, 6)), np.zeros((4, 6)), np.empty(6)
    for lost in (False, True, True, False, False):
        position = asked[0] + 1e-3 * rng.normal(size=6)
        before, position[2] = state.copy(), np.nan if lost else position[2]
        servo(tuned, M, asked, position, state, 5e-4, torque)
        speed = (position - before[0]) / 5e-4
        change = np.where(np.isnan(speed), 0.0, asked[1] - speed)
        filtered = np.where(np.isnan(position), 0.0, before[1] + tuned[NEW_WEIGHT] * (change - before[1]))
        correction = tuned[POSITION_GAIN] * (asked[0] - position) + tuned[VELOCITY_GAIN] * filtered
        np.testing.assert_allclose(torque, asked[2] + np.where(np.isnan(position), 0.0, correction), rtol=1e-12)


def test_an_arm_goes_on_after_its_encoder_has_returned(usual):
    drive = FaultyMujoco(usual.robot, faults=(LostEncoder("joint2", 0.1, 0.3),))
    done = drive.execute(usual)
    assert done.fault is not None and done.fault.joint == "joint2"
    drive.settling = 0.5
    again = drive.resume(done)
    assert again and np.isfinite(again.torque).all()
    assert np.abs(drive.measure() - usual.trajectory(usual.trajectory.duration)).max() <= 1e-4


def test_a_frozen_encoder_is_found_and_its_joint_braked(usual):
    drive = FaultyMujoco(usual.robot, faults=(LostEncoder("joint1", 0.2, 0.5, frozen=True),))
    done = drive.execute(usual)
    assert done.fault is not None and done.fault.joint == "joint1"
    assert np.abs(done.dq[-1]).max() <= 1e-4
    assert np.abs(errors(done)).max() <= 1.0  # it does not run away
    assert drive.resume(done)


@pytest.mark.parametrize("joint", range(6))
def test_with_a_frozen_encoder_the_fault_is_named_and_the_arm_really_comes_to_rest(usual, joint):
    rng = np.random.default_rng(joint)
    drive = FaultyMujoco(usual.robot, START, faults=(LostEncoder(joint, rng.uniform(0.0, 0.5), frozen=True),))
    done = drive.execute(usual)
    name = usual.robot.joint_names[joint]
    assert done.status == "fault" and done.fault.kind in ("encoder", "stall") and "encoder" in done.reason
    assert done.fault.joint == name or name in done.reason
    assert np.abs(done.dq[-1]).max() <= 0.02
    assert np.abs(done.q[-1] - done.q[-2]).max() <= 0.02 * 0.0005 * 1.5  # by its positions, too
    assert len(done.setpoints.q) == len(done.measured) and done.setpoints.t[-1] == pytest.approx(done.t[-1])


def test_an_arm_that_its_brakes_cannot_hold_is_said(usual, monkeypatch):
    monkeypatch.setattr(sys.modules["planners.cell.drives._simulated"], "BRAKING", 0.2)
    drive = FaultyMujoco(usual.robot, START, faults=(LostEncoder(1, 0.0, frozen=True),))
    monkeypatch.setattr(drive, "_put_brakes_on", lambda: None)
    done = drive.execute(usual)
    assert done.status == "fault" and "moves at" in done.reason and "with all brakes applied" in done.notes[-1]


def test_motors_that_are_too_weak_are_said(usual):
    weak = usual.robot.with_limits(torque=0.3 * usual.robot.limits.torque)
    done = MujocoDrive(usual.robot, plant=weak).execute(usual)
    assert (np.abs(done.torque).max(axis=0) <= weak.limits.torque).all()
    assert any("at its torque limit" in note for note in done.notes)


# ---------------------------------------------------------------- arms
def test_an_arm_without_masses_gets_stated_ones():
    robot = optik.load("irb120").with_limits(acceleration=5.0, jerk=100.0)
    found = plan(robot, [0.3, 0.2, -0.1, 0.2, 0.4, 0.1], np.zeros(6))
    done = MujocoDrive(robot).execute(found)
    assert done and np.abs(errors(done)).max() <= 2e-5 and done.torque is not None
    assert MujocoDrive(robot, plant=robot).plant.inertia == MujocoDrive(robot).plant.inertia
    assert "masses of 'irb120' are unknown" in done.notes[0] and "assumed" in done.notes[0]


def test_a_payload_of_unknown_mass_is_the_heaviest_and_the_model_takes_the_middle(usual):
    drive = MujocoDrive(usual.robot.with_payload((1.0, 2.0), inertia=np.diag([0.02, 0.02, 0.02])))
    assert drive.plant.payload.mass == 2.0
    done = drive.execute(line(drive.robot))
    assert done and any("middle of 1 to 2 kg" in note for note in done.notes)
    assert np.abs(errors(done)).max() >= 1e-4


def test_what_the_arm_carries_changes_model_and_plant(usual):
    robot = usual.robot.with_payload(1.0)
    plant = robot.with_inertia(viscous=0.0).with_payload(1.05)
    drive = MujocoDrive(robot, START, plant=plant)
    drive.carry(usual.robot.with_payload(3.0))
    assert np.isclose(drive.plant.payload.mass, 3.15) and not drive.plant.inertia.viscous.any()
    assert np.abs(drive.measure() - START).max() <= 1e-5
    assert drive.execute(line(drive.robot))
    drive.carry(usual.robot)
    assert drive.plant.payload is None


def test_bad_input_is_refused(usual):
    robot = usual.robot
    with pytest.raises(InvalidInput, match="step"):
        MujocoDrive(robot, step=0.001)
    for name, value in (("bandwidth", -1.0), ("bandwidth", [1.0, 2.0]), ("damping", np.nan), ("feedforward", 2)):
        with pytest.raises(InvalidInput, match=name):
            MujocoDrive(robot, **{name: value})
    with pytest.raises(InvalidInput, match="bandwidth, damping"):
        MujocoDrive(robot, bandwidth=200.0)
    others = (optik.load("puma560"), optik.load("irb120"), "panda", robot.with_base(optik.load("puma560").fixed[3]))
    for plant in others:
        with pytest.raises(InvalidInput, match="plant"):
            MujocoDrive(robot, plant=plant)
    inertia = robot.inertia.replace(mass=np.zeros(6), tensor=np.zeros((6, 3, 3)), motor=[1, 1, 1, 1, 1, 0])
    with pytest.raises(InvalidInput, match="joint6 moves no mass"):
        MujocoDrive(robot.with_inertia(inertia))
    with pytest.raises(InvalidInput, match="robot"):
        MujocoDrive("panda", feedforward=False)


def test_a_simulation_that_diverges_is_no_result():
    drive = MujocoDrive(pendulum(), [0.3])
    drive._data.qvel[:] = 1e8
    with pytest.raises(InvalidInput, match="diverged"):
        held(drive, 0.3, 1)


def test_without_mujoco_the_extra_is_named(monkeypatch, usual):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(MissingDependency, match=r"optik-toolkit\[sim\]"):
        make_drive("mujoco", usual.robot)


# ---------------------------------------------------------------- all arms
def limited(name):
    robot = optik.load(name)
    asked = {"velocity": 1.5, "acceleration": 10.0, "jerk": 200.0}
    return robot.with_limits(**{k: v for k, v in asked.items() if getattr(robot.limits, k) is None})


@pytest.mark.soak
@pytest.mark.parametrize("law", ["optimal", "ruckig", "toppra"])
@pytest.mark.parametrize("name", ["panda", "ur5e", "puma560", "iiwa14", "ur10e", "paper6r"])
def test_lines_and_joint_moves_of_arms_with_torque_limits_are_followed(name, law):
    robot, rng, kept = limited(name), np.random.default_rng(shift_seed(11)), 0
    low, high = np.maximum(robot.limits.lower, -2.5) * 0.8, np.minimum(robot.limits.upper, 2.5) * 0.8
    for k in range(20):
        start = rng.uniform(low, high)
        goal = robot.fk(start).copy()
        goal[:3, 3] += rng.normal(0.0, 0.1, 3)
        found = plan(robot, rng.uniform(low, high) if k % 2 else goal, start, timing=law)
        if not found:
            continue
        kept += 1
        done = MujocoDrive(robot).execute(found)
        assert done and np.abs(errors(done)).max() <= 1e-4
        if law != "toppra":  # whose accelerations jump: the set-points' cubics overshoot there
            ratio, bound = torque_ratios(done)
            # Counts of the encoders move joints that need next to no torque: half a percent of the motor's.
            assert (ratio <= 1.05 * bound + 0.005).all()
    assert kept >= 4
