# SPDX-License-Identifier: Apache-2.0
"""Where a hanging platform is, by its encoders, and what it may do there; pure."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from cabols_control.checks import FloatArray
from cabols_control.forward_kinematics import PoseState
from cabols_control.forward_kinematics.hanging import Hang
from cabols_control.rig import Rig
from cabols_control.rotations import angle_between
from cabols_control.supervision.faults import FaultName
from cabols_control.supervision.modes import OperatingMode
from cabols_hw.hanging.bridge import HangingBridge
from cabols_hw.hanging.hoist import Hoist
from cabols_hw.hanging.proof import GearProof
from cabols_hw.safety.config import SafetyConfig, SuspensionConfig
from cabols_hw.safety.faults import BridgeFault

LOOK_EVERY, CERTIFY_EVERY = 4, 40
"""Samples between two looks at where it hangs, and between two certificates of it."""
OPEN_S = 0.05
"""How long all switches must be open before they count."""
OFF_M, ASIDE_M, SET_DOWN_M = 3e-4, 0.03, 0.002
"""Height above the stand from which it hangs, way aside, and height below from which the stand
surely bears it [m]."""
DEEPEST_M = 0.008
"""How far below the stand it may be let down: the cables slacken there [m]."""
LENGTH_STD_M = 2e-4
"""Of the stretched cables' lengths."""
NEAR_M, NEAR_RAD = 0.05, 0.2
"""Half widths of the region in which no other pose may have the cables' lengths."""
SPEED_SHARE = 0.8
"""Of the envelope's speeds under load, that a way uses."""
FOLLOWED_M, FOLLOWED_M_S = 2e-4, 0.015
"""Motion at rest below which the told pose stays, and how fast it follows a larger one: slower than
a platform may be under load, so that a mode that begins meanwhile sees no motion."""
CLOSE_M = 3e-3
"""Way between both from which a load may begin: it goes on from the told pose."""
PROOF_TIME_S = 20.0
"""Longest time in LOADING on the stand without a proof of the gears."""
OVER_PROOF = 1.15
"""Largest pull in proven ones, where the platform hangs."""
DOUBTFUL = frozenset(
    {
        FaultName.CABLE,
        FaultName.SWITCH,
        FaultName.ENCODER,
        FaultName.MOTION,
        FaultName.POSE,
        FaultName.GEAR,
        FaultName.STATE_AGE,
    }
)
"""Faults after which encoders and gears are not believed until the next start on the stand."""


class HangingWatch:
    """Follows one platform from its stand and back.

    Attributes:
        hoist: where it is to be.
        hang: where it hangs by the encoders; None: not known.
        state: what forward kinematics knows of that pose.
        standing: whether the stand bears it, as far as encoders and switches show.
        proof: of the gears.
    """

    def __init__(self, rig: Rig, safety: SafetyConfig, declared: SuspensionConfig) -> None:
        """Start without knowledge.

        Args:
            rig: geometry, limbs, what hangs.
            safety: limits.
            declared: of the site.
        """
        self._safety, self._declared = safety, declared
        shape = rig.geometry
        self._stand = np.array(shape.reference_position), np.array(shape.reference_rotation)
        self._range = np.array(safety.position_range)
        speeds = safety.speed_loaded, safety.rotation_speed_loaded
        self.hoist = Hoist(*self._stand, *(SPEED_SHARE * speed for speed in speeds))
        self.hang: Hang | None = None
        self.state = PoseState.NOT_FOUND
        self.standing = False
        self.proof = GearProof(rig, declared.proof_pull, safety.tension_max)
        self._ticks = 0
        self._open_s = 0.0
        self._unproven_s = 0.0
        self._set_down = False
        self._settled, self._far = True, 0.0
        self._doubt = ""

    @property
    def where(self) -> tuple[FloatArray, FloatArray]:
        """(3,) [m] and (3, 3) of the platform, as far as is known: on its stand, or hanging."""
        if self.standing or self.hang is None:
            return self._stand
        return self.hang.position, self.hang.rotation

    def refusal(self, mode: OperatingMode, bridge: HangingBridge) -> str:
        """Say why a mode must not begin; empty: it may.

        Args:
            mode: that is asked for.
            bridge: with the newest sample.
        """
        if mode in (OperatingMode.STOPPED, OperatingMode.FAULT):
            return ""
        if mode == OperatingMode.PRETIGHTENING:
            # By the sample before: with the mode the bridge drops the zeros.
            if self._set_down:
                return ""
            return (
                "zeros are found on the stand alone, and encoders and switches do not show that "
                "the stand bears the platform: let it down, until all switches are open"
            )
        if mode != OperatingMode.LOADING:
            return f"{mode.name} would let the platform go: it hangs on its cables"
        if not bridge.zeroed.all():
            return "limbs have no zero: where the platform hangs is not known"
        if self._doubt and not self.standing:
            return (
                f"after {self._doubt} where it hangs is in doubt: bear it from below until all "
                "switches are open, and find the zeros anew"
            )
        if not self._far <= CLOSE_M:
            return "the told pose still comes to where the platform is, after a stop"
        if self.standing:
            return ""
        if self.hang is None or self.state is not PoseState.KNOWN:
            return f"where the platform hangs is not certain ({self.state.name.lower()})"
        if not self.proof.done:
            return "the gears have not been proven on the stand since the bridge's start"
        return ""

    def doubt(self, name: FaultName) -> None:
        """Note a fault: after some of them zeros, cables or gears may not be what they were.

        Args:
            name: of the fault.
        """
        if name in DOUBTFUL:
            self._doubt = self._doubt or str(name)
            self.proof.forget()

    def go(self, position: FloatArray, rotation: FloatArray) -> str:
        """Let the platform move to a pose, in LOADING.

        Args:
            position: (3,) base frame [m].
            rotation: (3, 3) from platform to base axes.

        Returns:
            Why it does not; empty: it does.
        """
        place, turn = self._stand
        away = position - place
        if not (np.abs(away) <= self._range).all():
            return (
                f"expected a position within {1e3 * self._range} mm of the stand, got "
                f"{np.round(1e3 * away, 1)} mm from it"
            )
        angle = angle_between(turn, rotation)
        if not angle <= self._safety.rotation_range:
            return (
                f"expected a turn of at most {self._safety.rotation_range:g} rad, got {angle:.3g}"
            )
        if not away[2] >= -DEEPEST_M:
            return (
                f"expected a position at most {1e3 * DEEPEST_M:g} mm below the stand, got "
                f"{-1e3 * away[2]:.1f} mm"
            )
        if not self.proof.done:
            return "the gears are not proven yet"
        self.hoist.go(position, rotation)
        return ""

    def sample(self, dt_s: float, bridge: HangingBridge, mode: OperatingMode) -> None:
        """Take a sample: where it is, where it is to be.

        Args:
            dt_s: since the one before [s].
            bridge: that took it.
            mode: operating mode.
        """
        self._ticks += 1
        self._open_s = 0.0 if bridge.switch_closed.any() else self._open_s + dt_s
        if self._ticks % LOOK_EVERY == 0:
            self._look(bridge)
            self._set_down = self._surely_stands(bridge)
        if mode == OperatingMode.LOADING:
            # Afterwards the told pose has to come to where the platform is.
            self._settled, self._far = False, 0.0
            self.hoist.step(dt_s)
        elif self._ticks % LOOK_EVERY == 0:
            self._follow(LOOK_EVERY * dt_s)

    def begin(self, mode: OperatingMode) -> None:
        """Enter a mode: a load begins where the platform is, a pre-tightening on the stand.

        Args:
            mode: that begins.
        """
        self.proof.rest()
        self._unproven_s = 0.0
        if mode == OperatingMode.PRETIGHTENING:
            # The zeros that said where it is are dropped: the stand alone says it.
            self.standing, self.hang = True, None
            self.proof.forget()
            self._doubt = ""
            self.hoist.put(*self._stand)
        else:
            self.hoist.put(self.hoist.position.copy(), self.hoist.rotation.copy())

    def _look(self, bridge: HangingBridge) -> None:
        if not bridge.zeroed.all():
            self.hang = None
            self.standing = self.standing or self._open_s >= OPEN_S
            return
        guess = self._stand if self.hang is None else (self.hang.position, self.hang.rotation)
        found = bridge.platform.hang(bridge.rest, *guess)
        self.hang = found if found.found else None
        if self.hang is None:
            self.state = PoseState.NOT_FOUND
            self.standing = self.standing and self._open_s >= OPEN_S
            return
        aside = self.hang.position - self._stand[0]
        near = float(np.hypot(aside[0], aside[1])) <= ASIDE_M
        self.standing = near and bool(aside[2] <= (OFF_M if self.standing else 0.0))
        if self._ticks % CERTIFY_EVERY == 0:
            lengths = bridge.platform.stretched(bridge.rest, self.hang)
            limits = LENGTH_STD_M, NEAR_M, NEAR_RAD
            self.state = bridge.platform.certified(self.hang, lengths, *limits)

    def _follow(self, dt_s: float) -> None:
        """Let the told pose come to where the platform is."""
        position, rotation = self.where
        told, turned = self.hoist.position, self.hoist.rotation
        way = position - told
        turn = Rotation.from_matrix(rotation @ turned.T).as_rotvec()
        far = max(float(np.linalg.norm(way)), self.hoist.arm * float(np.linalg.norm(turn)))
        self._far, self._settled = far, far <= FOLLOWED_M
        if not self._settled or self.hoist.moving:
            share = min(FOLLOWED_M_S * dt_s / max(far, FOLLOWED_M), 1.0)
            turns = Rotation.from_rotvec(share * turn).as_matrix()
            self.hoist.put(told + share * way, turns @ turned)

    def _surely_stands(self, bridge: HangingBridge) -> bool:
        """Whether the stand surely bears the platform, and the told pose is there."""
        if not self._settled:
            return False
        if self._open_s >= OPEN_S:
            return True
        if not bridge.zeroed.all() or self.hang is None or not self.standing:
            return False
        return bool(self.hang.position[2] <= self._stand[0][2] - SET_DOWN_M)

    def judge(self, dt_s: float, bridge: HangingBridge) -> BridgeFault | None:
        """Judge a sample in LOADING.

        Args:
            dt_s: since the one before [s].
            bridge: that took it.
        """
        if self.standing:
            return self._judge_proof(dt_s, bridge)
        if not self.proof.done:
            return BridgeFault(
                FaultName.GEAR, "the platform leaves its stand before its gears are proven"
            )
        if self._ticks % LOOK_EVERY:
            return None
        if self.hang is None or self.state is not PoseState.KNOWN:
            return BridgeFault(
                FaultName.POSE,
                f"where the platform hangs is not certain any more ({self.state.name.lower()})",
            )
        position, rotation = self.hang.position, self.hang.rotation
        away = float(np.linalg.norm(position - self.hoist.position))
        turn = angle_between(rotation, self.hoist.rotation)
        if not (away <= self._declared.deviation and turn <= self._declared.turn):
            return BridgeFault(
                FaultName.POSE,
                f"by its encoders the platform hangs {1e3 * away:.1f} mm and {turn:.3f} rad from "
                f"where it should; {1e3 * self._declared.deviation:g} mm and "
                f"{self._declared.turn:g} rad allowed",
            )
        most, limit = float(self.hang.tension.max()), OVER_PROOF * self._declared.proof_pull
        if not most <= limit:
            return BridgeFault(
                FaultName.TENSION,
                f"a cable pulls {most:.1f} N where the platform hangs, {limit:.1f} N allowed by "
                "the gears' proof",
            )
        return None

    def _judge_proof(self, dt_s: float, bridge: HangingBridge) -> BridgeFault | None:
        if self.proof.done:
            return None
        self._unproven_s += dt_s
        if self._unproven_s > PROOF_TIME_S:
            return BridgeFault(
                FaultName.GEAR,
                f"the gears are not proven after {PROOF_TIME_S:g} s: not all limbs pull "
                f"{self._declared.proof_pull:g} N",
            )
        return self.proof.step(dt_s, bridge.wound_length, bridge.tension, bridge.switch_closed)
