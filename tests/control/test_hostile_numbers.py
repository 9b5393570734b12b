# SPDX-License-Identifier: Apache-2.0
"""Numbers that are none, endless or absurd, in every field that the control laws read."""

import numpy as np
import pytest

from cabols_control.limb_control.controller import LimbController, LimbSample, TensionSetpoint
from cabols_control.rig import load_rig
from cabols_control.supervision.modes import MOVING, OperatingMode
from cabols_control.wrench_control.controller import DesiredWrench, WrenchController

HOSTILE = (np.nan, np.inf, -np.inf, 1e5, -1e12, 1e300, 1.7e308)
FIELDS = ("wound_length", "elongation", "tension", "cable_speed", "cable_acceleration", "setpoint")
PERIOD_S, CABLES = 0.001, 8
SETTLED = 30
"""Samples after which a law is where it goes on."""


@pytest.fixture(scope="module")
def rig():
    return load_rig()


def limb_sample(stamp_s, **wrong):
    usual = {
        "wound_length": np.zeros(CABLES),
        "elongation": np.full(CABLES, 0.01),
        "tension": np.full(CABLES, 20.0),
        "switch_closed": np.ones(CABLES, dtype=bool),
        "zeroed": np.ones(CABLES, dtype=bool),
        "cable_speed": np.zeros(CABLES),
        "cable_acceleration": np.zeros(CABLES),
    }
    return LimbSample(stamp_s, **{**usual, **wrong})


class Limbs:
    """A limb controller that answers one sample after the other."""

    def __init__(self, rig):
        self.controller, self.now_s = LimbController(rig), 1.0

    def run(self, mode, samples, setpoint=None, **wrong):
        """Answer some samples; return the largest current of all."""
        largest = 0.0
        for _ in range(samples):
            self.now_s += PERIOD_S
            tension = np.full(CABLES, 20.0) if setpoint is None else setpoint
            command = TensionSetpoint(self.now_s, tension, True)
            current = self.controller.step(limb_sample(self.now_s, **wrong), mode, command)
            # Written so that NaN stays.
            largest = np.maximum(largest, np.abs(current).max())
        return largest


@pytest.mark.parametrize("mode", [m for m in MOVING if m != OperatingMode.COMMISSIONING])
@pytest.mark.parametrize("field", FIELDS)
def test_limb_controller_commands_a_current_and_recovers_in_stopped(rig, mode, field):
    """Whatever comes for five samples: what is commanded is one, and nothing of it stays."""
    healthy = Limbs(rig)
    healthy.run(mode, SETTLED)
    healthy.run(OperatingMode.STOPPED, 5)
    healthy.run(mode, SETTLED)
    for number in HOSTILE:
        for limbs in (slice(3, 4), slice(None)):
            one = Limbs(rig)
            one.run(mode, SETTLED)
            wrong = np.full(CABLES, 20.0 if field in ("tension", "setpoint") else 0.0)
            wrong[limbs] = number
            largest = one.run(mode, 5, **{field: wrong})
            assert largest <= rig.control.current_limit, (number, field)
            one.run(OperatingMode.STOPPED, 5)
            one.run(mode, SETTLED)
            assert one.controller.fault is None, (number, one.controller.fault)
            same = np.allclose(one.controller.current, healthy.controller.current, atol=0.01)
            assert same, (number, one.controller.current, healthy.controller.current)


def test_one_absurd_elongation_does_not_stay_in_free_moving(rig):
    """Without a stop in between: a quarter of a second later the limbs follow as before."""
    for number in (0.5, -3.0, 1e5, 1e8):
        healthy, one = Limbs(rig), Limbs(rig)
        for limbs in (healthy, one):
            limbs.run(OperatingMode.FREE_MOVING, SETTLED, tension=np.full(CABLES, 7.0))
        one.run(OperatingMode.FREE_MOVING, 1, elongation=np.full(CABLES, number))
        rates = []
        for limbs in (healthy, one):
            limbs.run(OperatingMode.FREE_MOVING, 250, tension=np.full(CABLES, 7.0))
            rates.append(limbs.controller._work["limbs"]["cable_rate"][0])
        assert np.allclose(*rates, atol=1e-6), number


@pytest.mark.parametrize("field", ["measured", "desired", "position", "rotation", "stamp"])
def test_wrench_controller_commands_tensions_within_limits(rig, field):
    limits = rig.control.tension_min, rig.control.tension_max
    geometry = rig.geometry
    for number in HOSTILE:
        for part in (slice(2, 3), slice(None)):
            law, now_s = WrenchController(rig), 1.0
            for k in range(2 * SETTLED):
                now_s += PERIOD_S
                given = {
                    "measured": np.zeros(6),
                    "desired": np.array([10.0, 0.0, 0.0, 0.0, 0.0, 0.0]),
                    "position": np.array(geometry.reference_position),
                    "rotation": np.array(geometry.reference_rotation),
                    "stamp": np.array([now_s]),
                }
                if SETTLED <= k < SETTLED + 4:
                    given[field].reshape(-1)[part if field != "stamp" else slice(None)] = number
                law.hear_pose(float(given["stamp"][0]), given["position"], given["rotation"])
                law.place(now_s)
                wanted = DesiredWrench(now_s, given["desired"])
                tension = law.step(now_s, given["measured"], OperatingMode.LOADING, wanted)
                assert (tension >= limits[0] - 1e-6).all(), (number, tension)
                assert (tension <= limits[1] + 1e-6).all(), (number, tension)
                assert np.isfinite(law.control).all(), (number, law.control)
