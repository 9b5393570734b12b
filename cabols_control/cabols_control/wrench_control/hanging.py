# SPDX-License-Identifier: Apache-2.0
"""The wrench controller of a platform that hangs on its cables: it bears the weight, too; pure.

What it is told as measured is what the tensions exert beyond the weight: between the platform and
the world there is no sensor. A load begins on the stand: there all limbs first pull what their
gears are to be proven at, while the stand bears half of the weight.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cabols_control.checks import FloatArray
from cabols_control.errors import ConfigError
from cabols_control.rig import HangingLoad, Rig
from cabols_control.supervision.modes import OperatingMode
from cabols_control.tension import distribute
from cabols_control.wrench_control.controller import DesiredWrench, WrenchController
from cabols_control.wrench_control.tension_setpoint import DesiredTension, TensionReference

BORNE = 0.5
"""Share of the weight that the cables bear while gears are proven."""
STANDS = 0.3
"""Share of the weight that the stand bears at least where a load begins on it."""
OVER = 1.04
"""Pull in the proof's: limbs settle near what they are told."""
PROVING_S, LOWERING_S = 4.0, 2.0
"""How long limbs pull for the proof, and then less."""


def proof_tensions(
    rig: Rig, hanging: HangingLoad, bears: FloatArray, matrix: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Tensions at which gears are proven on the stand, and those that follow, each (n,) [N].

    Args:
        rig: limits.
        hanging: with the pull of the proof.
        bears: (6,) that the cables exert meanwhile, base axes [N, N m].
        matrix: (6, n) structure matrix there.

    Raises:
        ConfigError: if the limits leave no such tensions.
    """
    control, least = rig.control, OVER * hanging.proof_pull
    most = control.tension_max
    if rig.envelope is not None:
        most = min(most, 0.97 * rig.envelope.tension_max)
    found = distribute(matrix, bears, least, most) if most > least else None
    after = distribute(matrix, bears, control.tension_min, hanging.proof_pull)
    if found is None or not found.feasible or not after.feasible:
        raise ConfigError(
            f"proof_pull of safety.yaml: between {least:.1f} and {most:.1f} N no tensions bear "
            f"{BORNE:.0%} of the platform on its stand"
        )
    return np.array(found.tension), np.array(after.tension)


class HangingWrenchController(WrenchController):
    """WrenchController whose cables bear the platform.

    Attributes:
        proving: whether limbs pull for the proof of their gears.
    """

    def __init__(self, rig: Rig) -> None:
        """Start inactive at the reference pose.

        Args:
            rig: that says what hangs.

        Raises:
            ConfigError: if it does not.
        """
        if rig.hanging is None:
            raise ConfigError("the rig's files say nothing of a platform that hangs on its cables")
        self._hanging = rig.hanging
        most = min(rig.control.tension_max, rig.hanging.proof_pull)
        super().__init__(replace(rig, control=replace(rig.control, tension_max=most)))
        # The proof goes up to the rig's own limit.
        self._tensions = TensionReference(rig)
        self._since_s = np.inf
        self._total = np.zeros(6)
        self._entered = False
        # The stand is where the reference pose is.
        self._proof = proof_tensions(rig, rig.hanging, -BORNE * self.weight(), self._matrix)

    @property
    def proving(self) -> bool:
        """Whether limbs pull for the proof of their gears."""
        return self._since_s < PROVING_S

    def weight(self) -> FloatArray:
        """(6,) about the platform's origin, base axes [N, N m]."""
        return self._hanging.weight(self.pose[1])

    def step(
        self,
        stamp_s: float,
        measured: FloatArray,
        mode: OperatingMode,
        setpoint: DesiredWrench | None,
        tensions: DesiredTension | None = None,
    ) -> FloatArray:
        """Answer one wrench sample; see WrenchController.step.

        Args:
            stamp_s: when it was measured [s].
            measured: (6,) of the cables beyond the weight, at the origin, base axes [N, N m].
            mode: operating mode.
            setpoint: newest desired wrench, beyond the weight; None before the first: zero.
            tensions: not used: whatever tensions would let the platform go.

        Returns:
            (n,) tension within the limits [N]; meaningful only where `active`.
        """
        del tensions
        weight, dt_s = self.weight(), stamp_s - self._last_stamp
        if mode != OperatingMode.LOADING:
            self._entered, self._since_s = False, np.inf
        elif not self._entered:
            self._entered = True
            if -measured[2] > STANDS * -weight[2]:
                self._since_s = 0.0
        elif dt_s > 0.0:
            self._since_s += dt_s
        np.subtract(measured, weight, out=self._total)
        return super().step(stamp_s, self._total, mode, setpoint, self._led(stamp_s))

    def _led(self, stamp_s: float) -> DesiredTension | None:
        """Tensions of the proof and after it; None: the wrench law leads."""
        if not self._since_s < PROVING_S + LOWERING_S:
            if self._tensions.active:
                # What they lead to is what the law begins with.
                self._tensions.reset()
                self.active = False
            return None
        return DesiredTension(stamp_s, self._proof[0 if self.proving else 1])

    def _follow(self, stamp_s: float, dt_s: float, setpoint: DesiredWrench | None) -> None:
        super()._follow(stamp_s, dt_s, setpoint)
        self._reference -= self.weight()
