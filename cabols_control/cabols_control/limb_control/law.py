"""The limb law (3.10): tension control by an inner velocity loop, for n limbs at once."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numba import njit

from cabols_control.checks import BoolArray, FloatArray, finite_array, in_range
from cabols_control.errors import ShapeError
from cabols_control.gains import LimbGains


@njit(cache=True)
def limb_law_into(
    gains: FloatArray,
    current_limit: float,
    velocity_reference: FloatArray,
    position: FloatArray,
    dt_s: float,
    state: FloatArray,
    current: FloatArray,
) -> bool:
    """One step of (3.10); shapes as in LimbLaw.step, unchecked.

    Args:
        gains: (n, 2) k_I and k_P1.
        current_limit: bound on |current| [A].
        velocity_reference: (n,) k_P2 (tau_d - tau_hat), or a winding speed [m/s].
        position: (n,) elongation, or wound length [m].
        dt_s: time since the previous step [s].
        state: (n, 2) integral [m] and previous position [m]; updated.
        current: (n,) output [A].

    Returns:
        False if a reference or a position is not finite: nothing is changed then.
    """
    for i in range(gains.shape[0]):
        if not (np.isfinite(velocity_reference[i]) and np.isfinite(position[i])):
            return False
    for i in range(gains.shape[0]):
        velocity = (position[i] - state[i, 1]) / dt_s
        increment = (velocity_reference[i] - velocity) * dt_s
        integral = state[i, 0] + increment
        wanted = gains[i, 0] * integral - gains[i, 1] * velocity
        current[i] = min(max(wanted, -current_limit), current_limit)
        # Anti-windup: the integral goes on only as far as the current reaches its limit.
        excess = (wanted - current[i]) / gains[i, 0]
        if excess * increment > 0.0:
            integral -= excess if abs(excess) < abs(increment) else increment
        state[i, 0] = integral
        state[i, 1] = position[i]
    return True


def gain_matrix(gains: Sequence[LimbGains]) -> FloatArray:
    """Return (n, 2) k_I and k_P1, as limb_law_into wants them."""
    return np.array([[g.integral, g.velocity] for g in gains], dtype=np.float64)


class LimbLaw:
    """State of (3.10) for n limbs, with current limit, anti-windup and bumpless reset."""

    def __init__(self, gains: Sequence[LimbGains], current_limit: float) -> None:
        """Start at rest with zero current.

        Args:
            gains: one for each limb.
            current_limit: bound on |current| [A].
        """
        if not gains:
            raise ShapeError("gains: expected at least one limb, got none")
        self._gains = gain_matrix(gains)
        self._limit = in_range("current_limit", current_limit, 0.0, 100.0)
        self.tension_gain = np.array([g.tension for g in gains], dtype=np.float64)
        self.current = np.zeros(len(gains))
        self._state = np.zeros((len(gains), 2))

    @property
    def arrays(self) -> tuple[FloatArray, FloatArray]:
        """Gains and state, as limb_law_into wants them; the law's own, no copies."""
        return self._gains, self._state

    @property
    def limbs(self) -> int:
        """Number n of limbs."""
        return int(self.current.size)

    def reset(self, limb: int, position: float, current: float = 0.0) -> None:
        """Make the next output of one limb continue from a current, at rest at a position.

        Args:
            limb: index from 0.
            position: present elongation or wound length, whichever step will be given [m].
            current: what the limb's amplifier has now [A].
        """
        self._state[limb, 0] = current / self._gains[limb, 0]
        self._state[limb, 1] = position
        self.current[limb] = current

    def step(self, velocity_reference: FloatArray, position: FloatArray, dt_s: float) -> FloatArray:
        """Advance all limbs by one sample.

        Args:
            velocity_reference: (n,) desired winding speed [m/s]: k_P2 (tau_d - tau_hat) for
                tension control (see tension_gain), a constant for pre-tightening.
            position: (n,) elongation (or wound length) at this sample [m].
            dt_s: real time since the previous sample [s].

        Returns:
            (n,) current within the limit [A]; the same array at every call.

        Raises:
            ShapeError: on other shapes or non-finite input; the state is left as it was.
            OutOfRangeError: if dt_s is not positive.
        """
        shape = (self.limbs,)
        reference = finite_array("velocity_reference", velocity_reference, shape)
        place = finite_array("position", position, shape)
        in_range("dt_s", dt_s, 1e-6, 1.0)
        self.advance(reference, place, dt_s)
        return self.current

    def advance(self, velocity_reference: FloatArray, position: FloatArray, dt_s: float) -> bool:
        """Step without checks of shape and time, for the control loop; see limb_law_into."""
        return bool(
            limb_law_into(
                self._gains,
                self._limit,
                velocity_reference,
                position,
                dt_s,
                self._state,
                self.current,
            )
        )

    @property
    def saturated(self) -> BoolArray:
        """(n,) bool, true where the last output stands at the limit."""
        return np.abs(self.current) >= self._limit
