# SPDX-License-Identifier: Apache-2.0
"""The bridge's own motions by encoders and switches alone: braking, and giving way; pure."""

from __future__ import annotations

import numpy as np

from cabols_control.checks import BoolArray, FloatArray
from cabols_control.rig import Rig

LONGEST_BRAKING_S = 0.05
STILL_M_S = 0.005
"""A motor that winds in no faster than this needs no brake [m/s]."""
STOP_TIME_S = 0.04
"""In which full current can stop a motor that winds in as fast as it may: braking lasts 50 ms."""
RESPONSE_S = 0.004
"""Time constant with which a speed is corrected: a few samples and the current's ramp [s]."""
YIELD_SPEED_M_S = 0.3
"""At which a cable with a closed switch is paid out: faster than the robot may move [m/s]."""
YIELD_LENGTH_M = 0.5
"""Most cable that is paid out; then the motor stands still [m]."""
YIELD_N, SLACKEST_N, GAIN_N = 7.0, 3.0, 2.0
"""A tension above the first is paid out, too, where a switch is open: it may be stuck. So is one
above the second that has gained the third [N]."""
QUIET_S = 0.1
"""After the last switch has opened, amplifiers are off so much later [s]."""


class Motors:
    """What brings each motor to a speed: the current of (3.11) for it."""

    def __init__(self, rig: Rig) -> None:
        """Take the limbs' model.

        Args:
            rig: limbs and limits.
        """
        self._gain = np.array(rig.limbs.gain)
        self._time_constant = np.array(rig.limbs.time_constant)
        self._limit = rig.control.current_limit

    def current_for(self, wanted: FloatArray, speed: FloatArray) -> FloatArray:
        """(n,) currents [A] that bring (n,) speeds to the wanted ones [m/s]; neither winds in.

        Args:
            wanted: (n,) at most 0 [m/s].
            speed: (n,) now [m/s].
        """
        rate = (wanted - speed) / RESPONSE_S
        current = (wanted + self._time_constant * rate) / self._gain
        return pay_out_only(np.clip(current, -self._limit, self._limit), speed)


def pay_out_only(current: FloatArray, speed: FloatArray) -> FloatArray:
    """Return (n,) currents [A] by which no motor winds in: only one that pays out may be slowed.

    Args:
        current: (n,) wanted [A].
        speed: (n,) of the motors, winding in [m/s].
    """
    return np.where((current > 0.0) & (speed > -STILL_M_S), 0.0, current)


class Braking:
    """Full current against the motors that wind in, until they stand, for at most 50 ms.

    Attributes:
        current: (n,) newest output [A].
        active: whether it brakes.
        braked: (n,) motors that it brakes; the others are free for what follows.
    """

    def __init__(self, rig: Rig) -> None:
        """Start at rest.

        Args:
            rig: limbs and limits.
        """
        self._motors = Motors(rig)
        self.braked: BoolArray = np.zeros(rig.geometry.cables, dtype=np.bool_)
        self._end_s = -np.inf
        self._all = False
        self.current = np.zeros(rig.geometry.cables)
        self.active = False

    def begin(self, now_s: float, all_motors: bool = False) -> None:
        """Brake from now on.

        Args:
            now_s: now [s].
            all_motors: whether motors that pay out are stopped, too, until those that wind in
                stand: what pulls against them must not let go meanwhile.
        """
        self._end_s = now_s + LONGEST_BRAKING_S
        self.active, self._all = True, all_motors

    def step(self, now_s: float, speed: FloatArray) -> FloatArray:
        """Return the (n,) currents [A] for one sample; zero once it is over.

        Args:
            now_s: now [s].
            speed: (n,) of the motors, winding in [m/s].
        """
        self.braked = speed > STILL_M_S
        if self._all and self.braked.any():
            self.braked = np.ones_like(self.braked)
        return self.brake(now_s, speed)

    def brake(self, now_s: float, speed: FloatArray) -> FloatArray:
        """Return the (n,) currents [A] that stop the motors in `braked`; zero once it is over.

        Args:
            now_s: now [s].
            speed: (n,) of the motors, winding in [m/s].
        """
        if not self.active or now_s >= self._end_s or not self.braked.any():
            return self.stop()
        current = self._motors.current_for(np.zeros(speed.size), speed)
        self.current[:] = np.where(self.braked, current, 0.0)
        return self.current

    def stop(self) -> FloatArray:
        """Rest: zero currents from now on."""
        self.active = False
        self.braked[:] = False
        self.current[:] = 0.0
        return self.current


class Yielding:
    """Gives way to a platform that may move: each limb pays out while its switch is closed.

    It keeps every cable below the switch's tension, about, while the robot still moves, and never
    winds in. Where a switch is open although the estimate says that its cable pulls, the estimate
    counts; where an encoder is not believed, the way is that of the modelled speed.

    Attributes:
        current: (n,) newest output [A].
        armed: whether it watches the switches.
        active: whether a limb has been paid out lately: then the amplifiers must be on.
    """

    def __init__(self, rig: Rig) -> None:
        """Start at rest.

        Args:
            rig: limbs and limits.
        """
        n = rig.geometry.cables
        self._motors = Motors(rig)
        self._newest_s = np.nan
        self._paid_out = np.zeros(n)
        self._most = np.full(n, YIELD_N)
        self._may: BoolArray = np.zeros(n, dtype=np.bool_)
        self._quiet_s = -np.inf
        self.current = np.zeros(n)
        self.armed = False
        self.active = False

    def begin(self, now_s: float, trusted: BoolArray, tension: FloatArray) -> None:
        """Watch the switches from now on.

        Args:
            now_s: now [s].
            trusted: (n,) whether a limb may be moved.
            tension: (n,) as for step() [N].
        """
        self._newest_s = now_s
        self._most[:] = np.clip(tension + GAIN_N, SLACKEST_N, YIELD_N)
        self._paid_out[:] = 0.0
        self._may[:] = trusted
        self._quiet_s = now_s + QUIET_S
        self.armed = self.active = True

    def step(
        self, now_s: float, closed: BoolArray, tension: FloatArray, speed: FloatArray
    ) -> FloatArray:
        """Return the (n,) currents [A] for one sample.

        Args:
            now_s: now [s].
            closed: (n,) switches.
            tension: (n,) the most that each limb can pull by its estimate [N]; NaN: not known.
            speed: (n,) of the motors, winding in [m/s].
        """
        if not self.armed:
            return self.current
        self._paid_out += np.maximum(-speed, 0.0) * max(now_s - self._newest_s, 0.0)
        self._newest_s = now_s
        pays = (closed | (tension > self._most)) & self._may & (self._paid_out < YIELD_LENGTH_M)
        current = self._motors.current_for(np.where(pays, -YIELD_SPEED_M_S, 0.0), speed)
        moves = pays | (self._may & (np.abs(speed) > STILL_M_S))
        self.current[:] = np.where(moves, current, 0.0)
        if moves.any():
            self._quiet_s = now_s + QUIET_S
        self.active = now_s < self._quiet_s
        return self.current

    def stop(self) -> FloatArray:
        """Rest: zero currents from now on."""
        self.armed = self.active = False
        self.current[:] = 0.0
        return self.current
