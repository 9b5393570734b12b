# SPDX-License-Identifier: Apache-2.0
"""When the gauges' present voltages are the sensor's bias, and when not; pure.

A bias needs slack cables, a sensor at rest and a plausible change. Slackness is shown by the zeros
of a pre-tightening, or by paying a cable out after its switch has opened. Where the switches have
been open since the start, a cable may pull up to the switch's tension: such a bias is provisional
until the next pre-tightening's zeros show what the cables pulled when it was measured.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Any

import numpy as np

from cabols_control.checks import BoolArray, FloatArray, IntArray
from cabols_control.naming import limb_names
from cabols_hw.force_torque.ati import AXES
from cabols_hw.force_torque.sensor_bias import SensorBias

SLACK_PAYOUT = 1.5
"""Way past the switch's opening after which a cable is slack, in elongations at its tension."""
STILL_SHARE = 0.01
"""Largest spread of the load while it is averaged, of the sensor's range."""
STILL_M = 2e-4
"""Largest motion of a motor meanwhile, at the cable [m]."""
CHANGE_SHARE = 0.1
"""Largest change from the bias before, of the sensor's range."""
PATIENCE = 5
"""Averages that are tried before a tare is refused because something moves."""


class Slack(IntEnum):
    """What is known about a cable's slackness."""

    SHOWN = 0
    UNKNOWN = 1
    """Its switch has been open since the start: it pulls less than the switch's tension."""
    TAUT = 2


def slackness(limbs: Any, closed: BoolArray) -> IntArray:
    """(n,) Slack of the cables.

    Args:
        limbs: (n,) records of LIMB_READING.
        closed: (n,) switches.
    """
    stretch, zero, last_closed = limbs["stretch"], limbs["zero"], limbs["closed_stretch"]
    paid_out = stretch <= last_closed - SLACK_PAYOUT * limbs["switch_elongation"]
    shown = np.where(np.isfinite(zero), stretch <= zero, paid_out)
    never = np.isnan(zero) & np.isnan(last_closed)
    found = np.where(shown, Slack.SHOWN, np.where(never, Slack.UNKNOWN, Slack.TAUT))
    return np.asarray(np.where(closed, Slack.TAUT, found), dtype=np.int64)


class SensorTare:
    """The bias in force, the one that is being measured, and why there is none.

    Attributes:
        bias: in force; None: the wrench is not known.
        measuring: whether samples are being averaged.
        judged: whether the first tare has been decided, either way.
        refusal: why the newest tare was refused; empty if it was not.
        proven: newest bias that was shown to be one, to be kept; None before.
    """

    def __init__(
        self,
        serial: str,
        matrix: FloatArray,
        limits: FloatArray,
        samples: int,
    ) -> None:
        """Begin to measure, without any bias.

        Args:
            serial: of the sensor.
            matrix: (6, 6) of its calibration [N/V, N m/V].
            limits: (6,) its range [N, N m].
            samples: that are averaged.
        """
        self._serial, self._matrix, self._limits = serial, matrix, limits
        self._samples = samples
        self._before: SensorBias | None = None
        self._candidate: SensorBias | None = None
        self._stretch_at_tare: FloatArray | None = None
        self.bias: SensorBias | None = None
        self.proven: SensorBias | None = None
        self.judged = False
        self.refusal = ""
        self.measuring = True
        self._tries = PATIENCE
        self._restart()

    def adopt(self, bias: SensorBias) -> None:
        """Use a bias from before the start; it is renewed where slack cables can be shown.

        Args:
            bias: of this sensor.
        """
        self.bias, self.judged = bias, True

    @property
    def provisional(self) -> bool:
        """Whether a measured bias waits for the next pre-tightening to prove it."""
        return self._candidate is not None

    def begin(self, limbs: Any, closed: BoolArray) -> str:
        """Start to average; the bias in force stays until the new one is accepted.

        Args:
            limbs: (n,) records of LIMB_READING, newest.
            closed: (n,) switches, newest.

        Returns:
            Why it is refused at once; empty if it is not.
        """
        if taut := self._taut(slackness(limbs, closed)):
            self._refuse(taut)
            return self.refusal
        self.refusal = ""
        self.measuring = True
        self._tries = PATIENCE
        self._restart()
        return ""

    def _restart(self) -> None:
        self._count = 0
        self._sum, self._weight_sum = np.zeros(6), np.zeros(6)
        self._low, self._high = np.full(6, np.inf), np.full(6, -np.inf)
        self._motors: FloatArray | None = None

    def sample(
        self,
        time_ns: int,
        volts: FloatArray,
        weight: FloatArray,
        wound: FloatArray,
        limbs: Any,
        closed: BoolArray,
    ) -> bool:
        """Average one sample.

        Args:
            time_ns: of the sample [ns].
            volts: (6,) of the gauges, none at its end [V].
            weight: (6,) of the tool, sensor axes [N, N m].
            wound: (n,) cable on the pulleys [m].
            limbs: (n,) records of LIMB_READING.
            closed: (n,) switches.

        Returns:
            Whether `bias` has changed.
        """
        known = slackness(limbs, closed)
        if taut := self._taut(known):
            return self._refuse(taut)
        load = self._matrix @ volts - weight
        self._low, self._high = np.minimum(self._low, load), np.maximum(self._high, load)
        if self._motors is None:
            self._motors = wound.copy()
        still = bool((self._high - self._low <= STILL_SHARE * self._limits).all())
        if not still or not np.abs(wound - self._motors).max() <= STILL_M:
            self._tries -= 1
            self._restart()
            return False if self._tries > 0 else self._refuse("the sensor or a motor does not rest")
        self._sum += volts
        self._weight_sum += weight
        self._count += 1
        if self._count < self._samples:
            return False
        found = SensorBias(
            self._serial, time_ns, self._sum / self._count, self._weight_sum / self._count
        )
        return self._judge(found, limbs["stretch"].copy(), bool((known == Slack.SHOWN).all()))

    def _taut(self, known: IntArray) -> str:
        """Why the cables count as taut; empty if they do not."""
        taut = np.flatnonzero(known == Slack.TAUT)
        return f"{limb_names(taut)} not shown slack" if taut.size else ""

    def _judge(self, found: SensorBias, stretch: FloatArray, shown: bool) -> bool:
        """Accept an average, for good or until its proof, or refuse it."""
        self.measuring = False
        if implausible := self._implausible(found):
            return self._refuse(implausible)
        self.judged, self.refusal = True, ""
        if shown:
            self._candidate = None
            self.bias = self.proven = found
            return True
        self._candidate, self._stretch_at_tare, self._before = found, stretch, self.bias
        # An older bias was shown to be one; this one is not yet.
        if self.bias is None:
            self.bias = found
            return True
        return False

    def _implausible(self, found: SensorBias) -> str:
        """Why a bias cannot follow the one in force; empty if it can, or if there is none."""
        if self.bias is None:
            return ""
        before = self.bias.unloaded_volts(self._matrix)
        change = self._matrix @ (found.unloaded_volts(self._matrix) - before)
        allowed = CHANGE_SHARE * self._limits
        axis = int(np.argmax(np.abs(change) / allowed))
        if abs(change[axis]) <= allowed[axis]:
            return ""
        unit = "N" if axis < 3 else "N m"
        return (
            f"the bias would change by {change[axis]:.3g} {unit} along {AXES[axis]}, at most "
            f"{allowed[axis]:.3g} {unit} are plausible: a load, or another sensor?"
        )

    def _refuse(self, reason: str) -> bool:
        self.measuring = False
        self.judged = True
        kept = "the bias before stays" if self.bias else "the wrench is not known"
        self.refusal = (
            f"tare refused: {reason}; {kept}. Pay the cables out until they hang, then tare"
        )
        return False

    def settle(self, limbs: Any) -> bool:
        """Judge a provisional bias by the zeros that have come since; call when all are known.

        Args:
            limbs: (n,) records of LIMB_READING.

        Returns:
            Whether `bias` has changed.
        """
        candidate, stretch = self._candidate, self._stretch_at_tare
        if candidate is None or stretch is None:
            return False
        self._candidate = None
        pulled = stretch - limbs["zero"]
        changed = self.bias is not (candidate if not (pulled > 0.0).any() else self._before)
        if (pulled <= 0.0).all():
            self.bias = self.proven = candidate
            return changed
        self.bias = self._before
        worst = float(np.nanmax(pulled * limbs["stiffness"]))
        self._refuse(
            f"{limb_names(np.flatnonzero(~(pulled <= 0.0)))} pulled up to {worst:.1f} N meanwhile, "
            "as the zeros show now"
        )
        return changed
