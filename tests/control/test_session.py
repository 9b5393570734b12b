# SPDX-License-Identifier: Apache-2.0
"""Which supervisor's modes a node follows, and who is named as a second publisher."""

from __future__ import annotations

import math
import time

import numpy as np
import pytest
from cabols_msgs.msg import Mode, MotorCurrent

from cabols_control.rig import load_rig
from cabols_control.ros.lifetime.roles import GHOST_S, Publisher, Seconds
from cabols_control.ros.messages.layout import Layout
from cabols_control.ros.messages.topics import mode_layout, pose_layout
from cabols_control.ros.sessions import ModeFilter, ModeInput, living, same_session
from cabols_control.supervision.modes import MOVING, OperatingMode
from cabols_control.supervision.session import LOST_S, SILENT_S, YOUNG_S, SessionFollower

OLD, PRESENT, LATER = 100, 200, 300


@pytest.fixture
def follower():
    """A node that has followed a supervisor for long."""
    found = SessionFollower()
    assert found.admit(PRESENT, 0.0)
    for k in range(1, 101):
        found.hear(0.1 * k)
    return found


@pytest.mark.parametrize("session", [0, OLD, LATER, 2**64 - 1])
def test_no_other_session_is_followed_while_one_is_alive(follower, session):
    assert not follower.admit(session, 10.1)
    assert (follower.session, follower.dropped) == (PRESENT, 1)


def test_a_supervisor_that_was_restarted_is_followed(follower):
    assert follower.admit(LATER, 10.0 + 1.01 * SILENT_S)
    assert follower.session == LATER


def test_a_played_bag_is_not_followed_after_its_session(follower):
    assert not follower.admit(OLD, 10.0 + 2.0 * SILENT_S)
    assert not follower.admit(OLD, 10.0 + 2.0 * LOST_S, off_s=-86400.0)


def test_a_clock_that_was_set_back_locks_no_supervisor_out(follower):
    assert follower.admit(OLD, 10.0 + 1.01 * LOST_S, off_s=0.1)


def test_a_node_that_starts_while_a_bag_is_played_follows_the_supervisor():
    follower = SessionFollower()
    assert follower.admit(OLD, 5.0)
    assert follower.admit(PRESENT, 5.0 + 0.5 * YOUNG_S)
    assert not follower.admit(OLD, 5.0 + 0.6 * YOUNG_S)
    assert follower.session == PRESENT


@pytest.mark.parametrize("off_s", [3600.0, -3600.0, math.nan, math.inf])
def test_a_mode_of_another_time_begins_no_session(off_s):
    follower = SessionFollower()
    assert not follower.admit(PRESENT, 0.0, off_s)
    assert follower.session == 0


@pytest.mark.parametrize("mode", range(256))
def test_no_mode_that_does_not_exist_is_shown(mode):
    assert ModeFilter().admits(Mode(mode=mode)) == (mode <= 6)


@pytest.mark.parametrize("cause", [9, 99, 255])
def test_no_cause_that_does_not_exist_is_shown(cause):
    assert not ModeFilter().admits(Mode(mode=Mode.STOPPED, cause=cause))


def test_a_command_of_another_session_is_dropped_and_counted(follower):
    layout = Layout(MotorCurrent, {"limb": 1, "current": 1, "saturated": 1})
    command = layout.record()
    judge = same_session(layout, follower, lockstep=False)
    for session, admitted in ((0, False), (OLD, False), (LATER, False), (PRESENT, True)):
        command["session"][0] = session
        assert judge(command.raw()) == admitted
    assert follower.dropped == 3


def publisher(name, endpoint, topic="mode"):
    return Publisher(topic, f"/cabols/{name}", bytes([endpoint]))


def test_a_second_publisher_is_named_at_once():
    told = Seconds().look([publisher("supervisor", 1), publisher("stranger", 2)], 0.0)
    assert told == "mode has 2 publishers: /cabols/stranger, /cabols/supervisor"


def test_a_killed_node_beside_its_successor_is_none():
    seconds, both = Seconds(), [publisher("supervisor", 1), publisher("supervisor", 2)]
    assert seconds.look(both, 0.0) == seconds.look(both, 0.9 * GHOST_S) == ""
    assert "2 publishers" in seconds.look(both, 1.1 * GHOST_S)


def test_controllers_of_some_limbs_each_are_none():
    parts = [publisher(f"limb_controller_{k}", k, "motor_current") for k in (1, 2)]
    assert Seconds().look(parts, 0.0) == ""
    assert Seconds().look([*parts, publisher("other", 3, "motor_current")], 0.0)


NOW_NS = 5_000_000_000_000


@pytest.fixture
def judge():
    """The judge of a bridge's input of modes: it follows PRESENT, its newest sample is NOW_NS."""
    sessions = SessionFollower()
    assert sessions.admit(PRESENT, time.monotonic())
    found = ModeInput.__new__(ModeInput)
    found._layout = layout = mode_layout()
    found._sessions, found._strict, found._on_session = sessions, True, None
    found._clock_ns = lambda: NOW_NS
    found._mode_at, found._session_at = layout.offset_of("mode"), layout.offset_of("session")
    return found


def told(mode, off_s, session=PRESENT):
    message = mode_layout().record()
    message["mode"][0], message["session"][0] = mode, session
    message.stamp(NOW_NS + round(1e9 * off_s))
    return mode_layout().laid_out(message.raw())


@pytest.mark.parametrize("mode", MOVING)
@pytest.mark.parametrize("off_s", [-3600.0, -2.1, 2.1, 3600.0])
def test_a_bag_of_the_very_session_moves_nothing_while_it_lasts(judge, mode, off_s):
    """A test is recorded, and looked at by playing it beside the rig, which still runs."""
    assert judge._judge(told(mode, 0.01))
    assert not judge._judge(told(mode, off_s))
    assert judge._sessions.dropped == 1
    assert judge._sessions.session == PRESENT


@pytest.mark.parametrize("mode", [OperatingMode.STOPPED, OperatingMode.FAULT])
def test_a_mode_that_stops_is_obeyed_whatever_its_stamp(judge, mode):
    assert judge._judge(told(mode, -3600.0))


@pytest.fixture
def poses(monkeypatch):
    """A judge of poses, and what it says of a stamp at a time."""
    layout, sessions = pose_layout(load_rig("").geometry), SessionFollower()
    now = [100.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    judge = living(layout, sessions, lockstep=False)

    def hear(now_s, stamp_s):
        now[0] = now_s
        message = layout.record()
        message.stamp(round(1e9 * stamp_s))
        return judge(layout.laid_out(message.raw()))

    return hear


@pytest.mark.parametrize("step_s", [0.4, -0.4, -0.6, -2.0, -3600.0, -1e6, 0.6, 3600.0, 1e8])
@pytest.mark.parametrize("period_s", [0.004, 0.012])
def test_clock_that_is_set_under_load_makes_no_gap_in_the_poses(poses, step_s, period_s):
    """Clocks of robot and rig are set once, or to and fro: 0.1 s without a pose stop the rig."""
    accepted = []
    for k in range(600):
        now_s = 100.0 + period_s * k
        back = 150 <= k < 300 or k >= 450
        if poses(now_s, 1.7e9 + period_s * k + (step_s if back else 0.0)):
            accepted.append(now_s)
    assert np.diff(accepted).max() <= 0.06
    assert accepted[-1] == pytest.approx(now_s)


def test_poses_of_a_played_bag_are_dropped_while_the_robots_come(poses):
    for k in range(5):
        now_s = 100.0 + 0.004 * k
        assert poses(now_s, 1000.0 + 0.004 * k)
        assert not poses(now_s, 400.0 + 0.004 * k)
    # Late or out of order is no other stream's; and a silent one may be followed by another clock.
    assert poses(now_s, 999.9)
    assert poses(now_s + 0.2, 400.0)
