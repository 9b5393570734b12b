# SPDX-License-Identifier: Apache-2.0
"""Whether a recovery by the bridge itself lowers the load, as the sensor feels it; pure."""

from __future__ import annotations

import numpy as np

from cabols_control.checks import FloatArray
from cabols_hw.bridge.bridge import Bridge

GROWTH_N, GROWTH_NM = 15.0, 2.5
"""By how much force and torque may exceed what the estimates explain, since the recovery began."""
TIME_S = 0.005
"""For how long [s]."""


class RecoveryWatch:
    """Compares what the sensor feels while limbs are unloaded, or give way, with what they should.

    A recovery goes by encoders and by the currents' model. Where an encoder has stopped and its
    amplifier drives by itself, neither shows that the limb winds in: the sensor does. Only its
    change counts, so that no bias is needed.
    """

    def __init__(self) -> None:
        """Watch nothing."""
        self._felt: FloatArray | None = None
        self._expected = np.zeros(6)
        self._beyond_s = 0.0

    def begin(self, bridge: Bridge, tension: FloatArray) -> None:
        """Note what is felt and expected now.

        Args:
            bridge: with the sample's values.
            tension: (n,) the most that each limb can pull by all that is known of it [N].
        """
        self._felt, self._expected = _felt(bridge), _expected(bridge, tension)
        self._beyond_s = 0.0

    def end(self) -> None:
        """Watch nothing any more."""
        self._felt = None

    def grows(self, dt_s: float, bridge: Bridge, tension: FloatArray) -> bool:
        """Whether a load has grown that nothing explains; see begin().

        Args:
            dt_s: since the sample before [s].
            bridge: with the sample's values.
            tension: (n,) as for begin() [N].
        """
        if self._felt is None:
            return False
        load = self._expected + _felt(bridge) - self._felt
        explained = _expected(bridge, tension)
        force = np.linalg.norm(load[:3]) - np.linalg.norm(explained[:3])
        torque = np.linalg.norm(load[3:]) - np.linalg.norm(explained[3:])
        beyond = force > GROWTH_N or torque > GROWTH_NM
        self._beyond_s = self._beyond_s + dt_s if beyond else 0.0
        return self._beyond_s > TIME_S


def _felt(bridge: Bridge) -> FloatArray:
    """(6,) wrench that the sensor shows, base axes [N, N m]."""
    turn = bridge.rotation
    return np.concatenate([turn @ bridge.wrench[:3], turn @ bridge.wrench[3:]])


def _expected(bridge: Bridge, tension: FloatArray) -> FloatArray:
    """(6,) wrench of tensions (n,) [N], base axes [N, N m]; what is not known counts as nothing."""
    return np.asarray(bridge.structure @ np.nan_to_num(np.maximum(tension, 0.0)))
