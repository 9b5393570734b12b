# SPDX-License-Identifier: Apache-2.0
"""Poses extrapolated over their age: exact motions, and what must not be extrapolated."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cabols_control.poses.filters import DEGREE, FORGETTING, GAINS, go_on
from cabols_control.poses.track import Heard, hear_pose, place_platform, pose_time, pose_track

HORIZON_S = 0.04
PERIOD_S = 0.004


def turned(vector):
    return Rotation.from_rotvec(vector).as_matrix()


def begun(lag_s=0.0, horizon_s=HORIZON_S):
    return pose_track(np.zeros(3), np.eye(3), lag_s, horizon_s)


def follow(track, motion, until_s, period_s=PERIOD_S, start_s=0.0):
    """Tell the poses of a motion: time to (3,) and (3,) rotation vector. The last one's time."""
    times = np.arange(start_s, until_s, period_s)
    for t in times:
        place, vector = motion(t)
        hear_pose(track, t, np.asarray(place, dtype=float), turned(vector))
    return times[-1]


def steady(t):
    return [0.1 * t, -0.05 * t, 0.02 * t], [0.2 * t, 0.0, -0.1 * t]


def test_constant_speed_is_extrapolated_exactly():
    track = begun()
    last_s = follow(track, steady, 0.1)
    assert place_platform(track, last_s + 0.007)
    place, vector = steady(last_s + 0.007)
    assert track["place"][0] == pytest.approx(place, abs=1e-12)
    # The axis of this rotation is fixed, so that its speed is, too.
    assert track["turn"][0] == pytest.approx(turned(vector), abs=1e-9)
    assert track["velocity"][0] == pytest.approx([0.1, -0.05, 0.02, 0.2, 0.0, -0.1], abs=1e-9)


def test_constant_acceleration_is_learnt():
    track = begun()
    last_s = follow(track, lambda t: ([0.5 * t * t, 0.0, 0.0], [0.0, 1.0 * t * t, 0.0]), 0.2)
    place_platform(track, last_s + 0.008)
    at = last_s + 0.008
    assert track["place"][0, 0] == pytest.approx(0.5 * at * at, abs=1e-9)
    assert track["acceleration"][0, [0, 4]] == pytest.approx([1.0, 2.0], rel=1e-4)


def test_a_lag_is_added_to_the_age():
    track = begun(lag_s=0.012)
    last_s = follow(track, steady, 0.1)
    place_platform(track, last_s + 0.004)
    assert track["place"][0] == pytest.approx(steady(last_s + 0.016)[0], abs=1e-12)


def test_a_stale_pose_is_held_at_the_horizon():
    track = begun()
    last_s = follow(track, steady, 0.1)
    place_platform(track, last_s + 10.0)
    assert track["place"][0] == pytest.approx(steady(last_s + HORIZON_S)[0], abs=1e-12)
    assert not track["velocity"].any()
    assert not track["acceleration"].any()


def test_a_horizon_of_zero_extrapolates_nothing():
    track = begun(lag_s=0.01, horizon_s=0.0)
    last_s = follow(track, steady, 0.1)
    place_platform(track, last_s + 0.003)
    assert track["place"][0] == pytest.approx(steady(last_s)[0], abs=1e-15)


@pytest.mark.parametrize("jump", [0.0015, 0.005, 0.05])
def test_a_jump_is_taken_as_it_is_and_never_extrapolated(jump):
    """At 4 ms a jump of 5 mm would be 1.25 m/s, and 10 mm more after 8 ms."""
    track = begun()
    last_s = follow(track, lambda _: ([0.0] * 3, [0.0] * 3), 0.1)
    there = np.array([jump, 0.0, 0.0])
    assert hear_pose(track, last_s + PERIOD_S, there, np.eye(3)) == Heard.BEGUN
    for k in range(1, 5):
        place_platform(track, last_s + 0.01 * k)
        assert track["place"][0] == pytest.approx(there, abs=1e-15)


def test_a_turn_at_once_is_never_extrapolated():
    track = begun()
    last_s = follow(track, lambda _: ([0.0] * 3, [0.0] * 3), 0.1)
    there = turned([0.0, 0.0, 0.02])
    assert hear_pose(track, last_s + PERIOD_S, np.zeros(3), there) == Heard.BEGUN
    place_platform(track, last_s + 0.03)
    assert track["turn"][0] == pytest.approx(there, abs=1e-15)


def test_two_jumps_in_a_row_are_no_speed():
    track = begun()
    last_s = follow(track, lambda _: ([0.0] * 3, [0.0] * 3), 0.1)
    for k in (1, 2):
        hear_pose(track, last_s + k * PERIOD_S, np.array([0.003 * k, 0.0, 0.0]), np.eye(3))
    place_platform(track, last_s + 2 * PERIOD_S + 0.008)
    assert track["place"][0, 0] == pytest.approx(0.006, abs=1e-15)


def test_motion_goes_on_after_a_jump():
    track = begun()
    last_s = follow(track, steady, 0.1)
    last_s = follow(
        track, lambda t: (np.add(steady(t)[0], 0.01), steady(t)[1]), 0.2, start_s=last_s + PERIOD_S
    )
    place_platform(track, last_s + 0.008)
    assert track["place"][0] == pytest.approx(np.add(steady(last_s + 0.008)[0], 0.01), abs=1e-12)


def test_poses_out_of_order_and_twice_are_dropped():
    track = begun()
    last_s = follow(track, steady, 0.1)
    before = track.copy()
    assert hear_pose(track, last_s - PERIOD_S, np.zeros(3), np.eye(3)) == Heard.OLD
    assert hear_pose(track, last_s, np.zeros(3), np.eye(3)) == Heard.OLD
    assert hear_pose(track, last_s + 1e-6, np.ones(3), np.eye(3)) == Heard.OLD
    assert track.tobytes() == before.tobytes()


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_what_is_not_finite_is_dropped(bad):
    track = begun()
    last_s = follow(track, steady, 0.1)
    before = track.copy()
    now_s = last_s + PERIOD_S
    place, turn = np.array([bad, 0.0, 0.0]), np.full((3, 3), bad)
    assert hear_pose(track, now_s, place, np.eye(3)) == Heard.UNUSABLE
    assert hear_pose(track, now_s, np.zeros(3), turn) == Heard.UNUSABLE
    assert hear_pose(track, bad, np.zeros(3), np.eye(3)) == Heard.UNUSABLE
    assert track.tobytes() == before.tobytes()
    place_platform(track, bad)
    assert np.isfinite(track["place"]).all()
    assert np.isfinite(track["turn"]).all()


def test_a_gap_and_a_clock_that_goes_back_begin_anew():
    for step_s in (0.2, -3.0):
        track = begun()
        last_s = follow(track, steady, 0.1)
        there = np.array([0.3, 0.0, 0.0])
        assert hear_pose(track, last_s + step_s, there, np.eye(3)) == Heard.BEGUN
        place_platform(track, last_s + step_s + 0.005)
        assert track["place"][0] == pytest.approx(there, abs=1e-15)


def test_a_platform_that_stands_costs_no_new_matrices():
    track = begun()
    last_s = follow(track, lambda _: ([0.01, 0.0, 0.0], [0.0, 0.0, 0.1]), 0.1)
    assert place_platform(track, last_s)
    assert not place_platform(track, last_s + 0.003)


def test_a_lost_pose_and_uneven_times_do_not_matter():
    track = begun()
    random = np.random.default_rng(3)
    t = 0.0
    for _ in range(60):
        t += float(random.choice([0.003, 0.004, 0.005, 0.008, 0.012]))
        hear_pose(track, t, np.array([0.1 * t, 0.0, 0.0]), np.eye(3))
    place_platform(track, t + 0.006)
    assert track["place"][0, 0] == pytest.approx(0.1 * (t + 0.006), abs=1e-12)


def test_a_stamp_of_another_clock_gives_way_to_the_arrival():
    assert pose_time(10.001, 10.004) == 10.001
    assert pose_time(1.7e9, 10.004) == 10.004
    assert pose_time(np.nan, 10.004) == 10.004


NOISE_M, NOISE_RAD = 16e-6, 136e-6


def starting(t):
    """From rest to 100 mm/s within 0.1 s [m]."""
    return 0.5 * min(max(t, 0.0), 0.1) ** 2 + 0.1 * max(t - 0.1, 0.0)


def errors_of_noisy_poses(motion, until_s=3.0, seed=4):
    """(k, 3) errors of place [m] and (k, 3) of rotation [rad], 6 ms after each pose."""
    random = np.random.default_rng(seed)
    track, places, turns = begun(), [], []
    for t in np.arange(0.0, until_s, PERIOD_S):
        place, vector = motion(t)
        place = np.asarray(place, dtype=float) + random.normal(0.0, NOISE_M, 3)
        hear_pose(track, t, place, turned(vector) @ turned(random.normal(0.0, NOISE_RAD, 3)))
        place_platform(track, t + 0.006)
        place, vector = motion(t + 0.006)
        places.append(track["place"][0] - place)
        error = track["turn"][0] @ turned(vector).T
        turns.append(Rotation.from_matrix(error).as_rotvec())
    return np.array(places)[50:], np.array(turns)[50:]


def test_noise_of_a_platform_that_stands_is_not_multiplied():
    """Differences of the newest poses would make 100 um and 900 urad of it: newtons at springs."""
    places, turns = errors_of_noisy_poses(lambda _: ([0.0] * 3, [0.0] * 3))
    assert places.std(axis=0).max() < 0.6 * NOISE_M
    assert turns.std(axis=0).max() < 0.8 * NOISE_RAD


@pytest.mark.parametrize(
    ("motion", "most"),
    [
        (lambda t: ([0.02 * t, 0.0, 0.01 * t], [0.0, 0.0, 0.02 * t]), 2.0),
        (lambda t: ([0.01 * np.sin(np.pi * t), 0.0, 0.0], [0.0] * 3), 3.0),
        # At rest, then off at 100 mm/s within 0.1 s: what was learnt of rest must not hold it up.
        (lambda t: ([starting(t - 2.0), 0.0, 0.0], [0.0] * 3), 4.0),
    ],
)
def test_noise_is_filtered_without_a_lag_that_counts(motion, most):
    places, _ = errors_of_noisy_poses(motion)
    assert np.sqrt(np.mean(places[:, 0] ** 2)) < most * NOISE_M
    assert np.abs(places).max() < 16.0 * NOISE_M


@pytest.mark.parametrize(
    ("frequency", "amplitude", "most_m", "most"),
    [(2.0, 0.01, 2e-6, 0.02), (5.0, 0.004, 1e-5, 0.25)],
)
def test_shaking_without_noise_is_followed_in_place_and_acceleration(
    frequency, amplitude, most_m, most
):
    """The differences alone are 7 and 40 um, 0.04 and 0.6 m/s^2 off."""
    track, off, swing = begun(), [], 2.0 * np.pi * frequency
    for t in np.arange(0.0, 2.0, PERIOD_S):
        hear_pose(track, t, np.array([amplitude * np.sin(swing * t), 0.0, 0.0]), np.eye(3))
        for age_s in (0.004, 0.008, 0.012):
            place_platform(track, t + age_s)
            place = amplitude * np.sin(swing * (t + age_s))
            missed = track["place"][0, 0] - place, track["acceleration"][0, 0] + swing**2 * place
            off.append(missed)
    settled = np.array(off[300:])
    assert np.sqrt(np.mean(settled[:, 0] ** 2)) < most_m
    assert np.sqrt(np.mean(settled[:, 1] ** 2)) < most


def test_filters_correct_as_fading_memory_polynomials_do():
    """Brookner 1998, section 1.3: all roots at what is kept; the published gains of degree 2."""
    for degree, kept, gains in zip(DEGREE[1:], FORGETTING[1:], GAINS[1:], strict=True):
        orders = degree + 1
        on = np.zeros((5, 6))
        transition = np.zeros((orders, orders))
        for order in range(orders):
            on[:] = 0.0
            on[order, 0] = 1.0
            go_on(on, degree, 1.0)
            transition[:, order] = on[:orders, 0]
        missed = np.eye(orders) - np.outer(gains[:orders], np.eye(orders)[0])
        found = np.poly(missed @ transition)
        assert found == pytest.approx(np.poly(np.full(orders, kept)), abs=1e-6)
        if degree == 2:
            rest = 1.0 - kept
            published = [1.0 - kept**3, 1.5 * (1.0 - kept**2) * rest, rest**3]
            assert gains[:3] == pytest.approx(published, rel=1e-6)


def test_what_filters_knew_is_forgotten_by_a_jump():
    track = begun()
    last_s = follow(track, lambda _: ([0.0] * 3, [0.0] * 3), 1.0)
    last_s = follow(
        track, lambda t: (np.add(steady(t)[0], 0.05), steady(t)[1]), 1.1, start_s=last_s + PERIOD_S
    )
    place_platform(track, last_s + 0.006)
    assert track["place"][0] == pytest.approx(np.add(steady(last_s + 0.006)[0], 0.05), abs=1e-10)
