# SPDX-License-Identifier: Apache-2.0
"""Setpoints of the limbs' tensions from efforts of joints, as ros2_control sends them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cabols_control.checks import FloatArray
from cabols_control.errors import CabolsError
from cabols_control.naming import number

AXES = ("force_x", "force_y", "force_z", "torque_x", "torque_y", "torque_z")


def limb_joints(cables: int) -> tuple[str, ...]:
    """Names of the joints that stand for limbs: `cable_1` and so on, in the limbs' order."""
    return tuple(f"cable_{number(index)}" for index in range(cables))


def wrench_joints() -> tuple[str, ...]:
    """Names of the joints whose efforts are the six parts of the measured wrench."""
    return tuple(f"platform_{axis}" for axis in AXES)


class JointCommandError(CabolsError):
    """A command of joints cannot be used; nothing of it is."""


class JointCommands:
    """Turns commands of some or all limbs' joints into setpoints of all limbs.

    A limb that nobody commands keeps its tension: the one that it was last told, or the one that
    it had when commands began. Limits, rates and staleness are the wrench controller's
    (TensionReference); this class decides only who is commanded what.
    """

    def __init__(self, cables: int, timeout_s: float) -> None:
        """Know no command yet.

        Args:
            cables: number n of limbs.
            timeout_s: silence after which the limbs have been ramped down, so that a later command
                begins anew [s].
        """
        self._names = {name: index for index, name in enumerate(limb_joints(cables))}
        self._timeout_s = timeout_s
        self._held: FloatArray | None = None
        self._heard_s = -np.inf

    def reset(self) -> None:
        """Forget what the limbs were told: what they have at the next command is held."""
        self._held = None

    def take(
        self,
        now_s: float,
        names: Sequence[str],
        efforts: Sequence[float],
        measured: FloatArray,
    ) -> FloatArray | None:
        """Take one command.

        Args:
            now_s: when it came, on a clock that is never set [s].
            names: of joints that stand for limbs, each once, in any order.
            efforts: of each of them [N]; NaN: no controller commands it.
            measured: (n,) tensions of all limbs [N].

        Returns:
            (n,) setpoints of all limbs [N]; None if no controller commands any.

        Raises:
            JointCommandError: if names are unknown or twice, numbers differ in length or are
                infinite, or a limb that is not commanded has no tension to keep.
        """
        unknown = [name for name in names if name not in self._names]
        if unknown:
            raise JointCommandError(
                f"limb_joint_commands: expected joints of {', '.join(self._names)}, got "
                f"{', '.join(unknown[:3])}"
            )
        if len(set(names)) != len(names):
            raise JointCommandError(
                f"limb_joint_commands: expected each joint once, got {', '.join(names)}"
            )
        if len(efforts) != len(names):
            raise JointCommandError(
                f"limb_joint_commands: expected an effort [N] for each of {len(names)} joints, got "
                f"{len(efforts)}; positions and velocities do not command a tension"
            )
        values = np.array(efforts, dtype=np.float64)
        if np.isinf(values).any():
            raise JointCommandError(
                f"limb_joint_commands: expected finite efforts [N], or NaN where no controller is, "
                f"got {values.tolist()}"
            )
        given = np.isfinite(values)
        if not given.any():
            return None
        if self._held is None or now_s - self._heard_s > self._timeout_s:
            self._held = np.array(measured, dtype=np.float64)
        at = np.array([self._names[name] for name in names])[given]
        self._held[at] = values[given]
        if not np.isfinite(self._held).all():
            self._held = None
            raise JointCommandError(
                "limb_joint_commands: expected tensions of all limbs, to keep where none is "
                "commanded, got limbs without a zero; pre-tighten first"
            )
        self._heard_s = now_s
        return self._held.copy()
