"""A stream of targets as a learned policy emits them, noisy and late, beside hard replacement and Ruckig to each target.

python examples/policy_stream.py [PLOT.html]
"""

import sys

import numpy as np
import ruckig
from plotly.subplots import make_subplots

import optik
import planners

robot = optik.load("panda")
home, n = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]), robot.n
limits = planners.MotionLimits.of(robot, jerk=5000.0, torque=None, torque_rate=None)
v, a, j = (limits.bounds(n)[name] for name in ("velocity", "acceleration", "jerk"))
rng = np.random.default_rng(1)
size, speed = rng.uniform(0.2, 0.5, n), rng.uniform(1.0, 2.5, n)
targets, state = [], {"seen": 0.0, "due": 0.0, "chunk": None}  # the newest target at each tick; the policy's own


def policy(now: planners.streams.Setpoint) -> planners.streams.Chunk | None:
    """Return a second of targets at 20 Hz, up to 0.3 s after the policy looked."""
    if (chunk := state["chunk"]) is not None:  # what a loop without a planner sends: the chunk's target of this instant
        targets.append((now.t, chunk.points[min(int((now.t - chunk.observed) * 20.0), 19)]))
    if now.t < state["due"] or now.t > 4.0:
        return None
    t = state["seen"] + np.arange(20)[:, None] / 20.0
    points = home + size * np.sin(t * speed) + rng.normal(size=(20, n)) * 1e-3 + rng.normal(size=n) * 4e-3
    chunk = planners.streams.Chunk(points, rate=20.0, observed=state["seen"])
    state.update(seen=now.t, due=now.t + rng.uniform(0.0, 0.3), chunk=chunk)
    return chunk


flow = planners.stream(robot, policy, home, limits=limits, realtime=False, silence=0.2)
t, q = (np.array(x) for x in list(zip(*flow, strict=True))[:2])
chaser, problem, reply, chased = ruckig.Ruckig(n, 1e-3), ruckig.InputParameter(n), ruckig.OutputParameter(n), []
problem.current_position, problem.max_velocity, problem.max_acceleration, problem.max_jerk = map(list, (home, v, a, j))
for _, target in targets:
    problem.target_position = list(target)
    chaser.update(problem, reply)
    reply.pass_to_input(problem)
    chased.append(reply.new_position)
t_target, hard, chased = (np.array(x) for x in (*zip(*targets, strict=True), chased))

print(flow.report())
figure = make_subplots(rows=2, shared_xaxes=True, y_title="velocity over its limit, and position [rad], of joint 1")
ways = {"grey": ("hard replacement", hard, t_target), "green": ("Ruckig to each target", chased, t_target)}
for colour, (name, x, at) in (ways | {"blue": ("stream", q, t)}).items():
    rate, inside = np.diff(x, axis=0) * 1e3 / v, (at > 0.5) & (at < 4.0)
    off = np.abs(x - home - size * np.sin(at[:, None] * speed))[inside].max(axis=1)
    print(
        f"{name}: {1e3 * np.sqrt((off**2).mean()):.1f} mrad RMS, velocity up to {np.abs(rate).max():.2f} of the limit"
    )
    figure.add_scatter(x=at, y=x[:, 0], name=name, row=2, col=1, line_color=colour)
    figure.add_scatter(x=at, y=rate[:, 0].clip(-2, 2), row=1, col=1, showlegend=False, line_color=colour)
figure.add_hline(1.0, row=1, col=1).add_hline(-1.0, row=1, col=1)
figure.write_html(sys.argv[1] if len(sys.argv) > 1 else "policy_stream.html")
