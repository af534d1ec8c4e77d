"""The start of an arm without a home: regular, free, away from the ends of its ranges, without whole turns."""

import numpy as np
import pytest

import optik
from optik import JointLimits, se3
from optik.arm.model import unit_factors
from optik.ik.start import wind_near
from optik.scene.contact import find_contact
from tests.robots import each_robot


@each_robot
def test_the_start_is_free_and_inside_and_its_shortest_line_is_as_long_as_the_best_of_other_samples(name):
    arm = optik.load(name)
    q, half = optik.choose_start(arm), arm.limits.half
    assert (np.abs(q - arm.limits.middle)[np.isfinite(half)] <= 0.8 * half[np.isfinite(half)] + 1e-3).all()
    assert (np.abs(q)[~arm.prismatic] <= np.pi + 1e-9).all()
    assert np.array_equal(q, optik.choose_start(arm))
    np.testing.assert_allclose(q * unit_factors(arm), np.round(q * unit_factors(arm), 1), atol=1e-9)
    assert arm.shapes is None or find_contact(arm, optik.Scene(), q).distance > 0.0
    others = arm.limits.sample(np.random.default_rng(1), 10)
    points = arm.fk(arm.limits.sample(np.random.default_rng(2), 200))[:, :3, 3]
    most = 0.3 * np.linalg.norm(points - points.mean(axis=0), axis=1).max()
    lines = [min(measure_line(arm, each, way, most) for way in (*np.eye(3), *-np.eye(3))) for each in (q, *others)]
    assert lines[0] >= max(lines[1:]) - most / 40


def measure_line(arm, q, way, most):
    """Follow a line with the point, and the orientation for six joints, by Euler steps with corrections; return its length."""
    T, rows, x = arm.fk(q), 6 if arm.n >= 6 else 3, q
    for k in range(40):
        goal = se3.pose(T[:3, :3], T[:3, 3] + (k + 1) / 40 * most * way)
        for _ in range(3):
            x = x + np.linalg.lstsq(arm.jacobian(x)[:rows], arm.pose_errors(x, goal)[:rows], rcond=1e-9)[0]
        if np.linalg.norm(arm.pose_errors(x, goal)[:rows]) > 1e-3 * most or not arm.limits.contains(x):
            return k / 40 * most
    return most


@pytest.mark.parametrize(
    ("lower", "upper"),
    [(-7.0, 7.0), (3.5, 9.0), (-9.0, -3.5), (-np.inf, np.inf), (4.0, np.inf), (0.3, 0.3), (-6.0, 0.0)],
)
def test_ranges_of_every_kind_have_a_start_inside_and_nearest_to_zero(lower, upper):
    arm = optik.load("ur5e")
    limits = JointLimits(np.full(6, lower), np.full(6, upper))
    arm = arm.with_limits(lower=limits.lower, upper=limits.upper)
    q = optik.choose_start(arm)
    assert arm.limits.contains(q)
    assert lower > np.pi or upper < -np.pi or np.abs(q).max() <= np.pi
    for k in range(-3, 4):
        turned = q + 2.0 * np.pi * k
        inside = (turned >= lower) & (turned <= upper)
        assert (np.abs(turned)[inside] >= np.abs(q)[inside] - 1e-9).all()


def test_a_start_with_contact_between_links_is_left_out(monkeypatch):
    arm = optik.load("ur5e")
    best = optik.choose_start(arm)
    monkeypatch.setattr(
        "optik.scene.contact.find_nearest_pairs",
        lambda arm, scene, q: (np.where((q == best).all(axis=1), -1.0, 1.0), None),
    )
    assert not np.array_equal(optik.choose_start(arm), best)


def test_winding_is_that_of_all_turns_tried():
    rng, arm = np.random.default_rng(5), optik.load("ur5e")
    for _ in range(200):
        low, high = np.sort(rng.uniform(-12.0, 12.0, (2, 6)), axis=0)
        bent = arm.with_limits(lower=low, upper=high)
        q, near = rng.uniform(low, high), rng.uniform(-9.0, 9.0, 6)
        found = wind_near(bent, q, near)
        tried = q + 2.0 * np.pi * np.arange(-8, 9)[:, None]
        away = np.where((tried >= low) & (tried <= high), np.abs(tried - near), np.inf)
        np.testing.assert_allclose(np.abs(found - near), away.min(axis=0), atol=1e-12)
        assert bent.limits.contains(found)


def test_a_sliding_joint_is_not_turned():
    arm = optik.load("irb910sc")
    q = optik.choose_start(arm)
    assert np.array_equal(wind_near(arm, q, np.full(arm.n, 50.0))[arm.prismatic], q[arm.prismatic])
