# SPDX-License-Identifier: Apache-2.0
"""The bridge of a platform that hangs on its cables: no sensor holds it; pure."""

from __future__ import annotations

from cabols_control.checks import FloatArray
from cabols_control.errors import ConfigError
from cabols_control.forward_kinematics.hanging import HangingPlatform
from cabols_control.rig import Rig
from cabols_control.supervision.modes import OperatingMode
from cabols_hw.bridge.bridge import Bridge
from cabols_hw.card.config import CardConfig
from cabols_hw.card.daq import CardSample


class HangingBridge(Bridge):
    """Bridge whose wrench is what the cables' tensions exert beyond the weight.

    Attributes:
        platform: finds where the platform hangs.
    """

    def __init__(self, rig: Rig, card: CardConfig, closings: int = 1) -> None:
        """Start unzeroed at the reference pose.

        Args:
            rig: whose samples come; it says what hangs.
            card: that gives them.
            closings: of a switch before one sets its limb's zero; see scaling.CLOSINGS.

        Raises:
            ConfigError: if the rig's files do not say what hangs on the cables.
        """
        super().__init__(rig, card, closings)
        if rig.hanging is None:
            raise ConfigError("the rig's files say nothing of a platform that hangs on its cables")
        self.platform = HangingPlatform(
            rig.geometry, rig.springs, rig.hanging.mass, rig.hanging.centre
        )

    @property
    def rest(self) -> FloatArray:
        """(n,) lengths of the slack cables, NaN without a zero [m]."""
        zero: FloatArray = self.limbs["zero"]
        return zero - self.wound_length

    def take(self, sample: CardSample, mode: OperatingMode, zeroing: int = 0) -> None:
        """Update all attributes from one sample; see Bridge.take.

        Args:
            sample: just read.
            mode: operating mode.
            zeroing: number of the newest pre-tightening, from Mode.
        """
        super().take(sample, mode, zeroing)
        if not self.zeroed.all():
            self.wrench[:] = 0.0
            return
        beyond = self.structure @ self.tension + self.platform.weight_at(self.rotation)
        self.wrench[:3] = self.rotation.T @ beyond[:3]
        self.wrench[3:] = self.rotation.T @ beyond[3:]

    def _use_bias(self) -> None:
        """Use none: what a sensor shows is not the platform's."""
