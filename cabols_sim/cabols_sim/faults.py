# SPDX-License-Identifier: Apache-2.0
"""Faults of the simulated rig; pure, applied by the plant."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cabols_control.checks import BoolArray, FloatArray, IntArray
from cabols_control.errors import CabolsError
from cabols_control.naming import limb_name


class FaultError(CabolsError):
    """A fault does not exist, or its arguments do not fit."""


@dataclass(frozen=True)
class FaultKind:
    """One kind of fault.

    Attributes:
        default: its size if none is given.
        unit: of its size; empty where it has none.
        per_limb: whether it needs a limb.
        what: for help texts.
    """

    default: float
    unit: str
    per_limb: bool
    what: str


KINDS: dict[str, FaultKind] = {
    "cable_break": FaultKind(0.0, "", True, "the cable parts"),
    "cable_slip": FaultKind(0.005, "m", True, "the cable slips on its winch"),
    "switch_open": FaultKind(0.0, "", True, "the limit switch stays open"),
    "switch_closed": FaultKind(0.0, "", True, "the limit switch stays closed"),
    "encoder_jump": FaultKind(0.01, "m", True, "the encoder gains counts at once"),
    "encoder_frozen": FaultKind(0.0, "", True, "the encoder's count stays"),
    "motor_jam": FaultKind(0.0, "", True, "the motor does not turn"),
    "amplifier_offset": FaultKind(1.0, "A", True, "the amplifier adds a current"),
    "gauge_flat": FaultKind(0.0, "gauge", False, "one gauge shows the same voltage"),
    "gauge_nan": FaultKind(0.0, "gauge", False, "one gauge gives no number"),
    "gauge_saturated": FaultKind(0.0, "gauge", False, "one gauge stands at its end"),
    "gauge_drift": FaultKind(5.0, "V/s", False, "gauge 0 drifts"),
    "platform_runs": FaultKind(0.1, "m/s", False, "the platform moves along x"),
    "pose_offset": FaultKind(0.5, "m", False, "the reported pose is off in x"),
    "pose_silent": FaultKind(0.0, "", False, "no pose is reported"),
    "egm_loss": FaultKind(0.3, "", False, "share of the robot's packets that get lost"),
    "egm_delay": FaultKind(0.05, "s", False, "the robot's packets come late"),
    "robot_stopped": FaultKind(0.0, "", False, "an operator presses the robot's emergency stop"),
    "beam": FaultKind(0.0, "", False, "the laser tracker's beam is blocked"),
}


@dataclass
class _Active:
    kind: str
    limb: int
    value: float
    end_s: float
    since_s: float


class PlantFaults:
    """The faults in force, and their effect on the plant's signals.

    Attributes:
        any: whether anything is wrong; the plant asks before it calls the rest.
    """

    def __init__(self, limbs: int) -> None:
        """Start without a fault."""
        self._limbs = limbs
        self._active: list[_Active] = []
        self._frozen: dict[str, float] = {}
        self.any = False

    def inject(
        self,
        kind: str,
        limb: int = -1,
        value: float = 0.0,
        duration_s: float = 0.0,
        now_s: float = 0.0,
    ) -> str:
        """Cause a fault from now on.

        Args:
            kind: a key of KINDS, or "none" to mend everything (a broken cable, too).
            limb: index, for faults of a limb.
            value: the fault's size; 0 for its default.
            duration_s: 0 for ever.
            now_s: the plant's time.

        Returns:
            What was done.

        Raises:
            FaultError: if the kind is unknown or the limb does not exist.
        """
        if kind == "none":
            self._active, self._frozen, self.any = [], {}, False
            return "everything mended"
        if kind not in KINDS:
            raise FaultError(f"fault: expected none, {', '.join(KINDS)}; got {kind!r}")
        described = KINDS[kind]
        if described.per_limb and not 0 <= limb < self._limbs:
            raise FaultError(
                f"{kind}: expected a limb index from 0 to {self._limbs - 1}, got {limb}"
            )
        if not (np.isfinite(value) and np.isfinite(duration_s) and duration_s >= 0.0):
            raise FaultError(f"{kind}: expected finite numbers, got {value}, {duration_s}")
        size = value or described.default
        end_s = now_s + duration_s if duration_s > 0.0 else np.inf
        self._active.append(_Active(kind, limb, size, end_s, now_s))
        self._frozen = {}
        self.any = True
        where = f" of {limb_name(limb)}" if described.per_limb else ""
        return f"{kind}{where}: {described.what}"

    def pass_time(self, now_s: float) -> None:
        """End the faults whose duration is over."""
        self._active = [fault for fault in self._active if fault.end_s > now_s]
        self.any = bool(self._active)

    def value(self, kind: str) -> float:
        """Size of a fault in force; 0 if it is not."""
        return next((fault.value for fault in self._active if fault.kind == kind), 0.0)

    def has(self, kind: str) -> bool:
        """Whether a fault is in force."""
        return any(fault.kind == kind for fault in self._active)

    def slipped(self) -> FloatArray:
        """(n,) how far cables have slipped on their winches [m]."""
        found = np.zeros(self._limbs)
        for fault in self._active:
            if fault.kind == "cable_slip":
                found[fault.limb] += fault.value
        return found

    def limbs_with(self, kind: str) -> list[int]:
        """Limbs that have a fault."""
        return [fault.limb for fault in self._active if fault.kind == kind]

    def distort_current(self, current: FloatArray) -> None:
        """Change the (n,) motor currents [A]."""
        for fault in self._active:
            if fault.kind == "amplifier_offset":
                current[fault.limb] += fault.value

    def distort_senses(
        self,
        now_s: float,
        counts_per_metre: float,
        counts: IntArray,
        volts: FloatArray,
        lines: BoolArray,
        active_low: bool,
    ) -> None:
        """Change what the card reads, in place.

        Args:
            now_s: the plant's time [s].
            counts_per_metre: of the encoders, by cable length [1/m].
            counts: (n,) of the encoders.
            volts: (6,) of the force/torque sensor's gauges [V].
            lines: (n,) levels of the limit switches' inputs.
            active_low: whether a closed switch pulls its line down.
        """
        for fault in self._active:
            kind, i = fault.kind, fault.limb
            if kind == "encoder_jump":
                counts[i] += round(fault.value * counts_per_metre)
            elif kind == "encoder_frozen":
                counts[i] = int(self._keep(f"encoder {i}", float(counts[i])))
            elif kind in ("switch_open", "switch_closed"):
                lines[i] = (kind == "switch_closed") != active_low
            elif kind.startswith("gauge"):
                self._distort_gauge(kind, fault, now_s, volts)

    def _distort_gauge(self, kind: str, fault: _Active, now_s: float, volts: FloatArray) -> None:
        if kind == "gauge_drift":
            volts[0] += fault.value * (now_s - fault.since_s)
            return
        gauge = int(fault.value) % 6
        stuck = {"gauge_nan": float("nan"), "gauge_saturated": 10.0}
        keep = kind == "gauge_flat"
        volts[gauge] = self._keep(f"gauge {gauge}", float(volts[gauge])) if keep else stuck[kind]

    def _keep(self, key: str, value: float) -> float:
        """Return a signal's value at the instant at which it froze."""
        return self._frozen.setdefault(key, value)
