# SPDX-License-Identifier: Apache-2.0
"""The bridge's share in the check at first power-on: whether it is required, and has passed."""

from __future__ import annotations

from cabols_control.commissioning.power_on_record import (
    configuration_hash,
    passed_limbs,
    record_path,
)
from cabols_control.errors import ConfigError
from cabols_control.ros.node import ControlNode
from cabols_control.ros.parameters import declare_row
from cabols_control.supervision.faults import Fault, FaultName
from cabols_hw.bringup_nodes import NODES as HW_NODES
from cabols_hw.safety.first_power_on import UNCHECKED, PowerOnBound
from cabols_hw.safety.guard import BridgeGuard

AUTO, REQUIRED, SKIPPED = "auto", "required", "skipped"


class PowerOnGate:
    """Bounds the guard until the check has passed; its result is looked for at rest.

    Attributes:
        notice: what is to be said; None once it has passed.
    """

    def __init__(self, node: ControlNode, guard: BridgeGuard, required: bool) -> None:
        """Declare the parameter; look for the result.

        Args:
            node: of the bridge.
            guard: of its amplifiers.
            required: whether `auto` means required.

        Raises:
            ConfigError: if the parameter is none of its values.
        """
        chosen = declare_row(node, HW_NODES.argument("power_on_check"))
        if chosen not in (AUTO, REQUIRED, SKIPPED):
            raise ConfigError(
                f"power_on_check: expected {AUTO}, {REQUIRED} or {SKIPPED}, got {chosen!r}"
            )
        cables = node.rig.geometry.cables
        self._guard = guard
        self._limbs = frozenset(range(cables))
        self._path = record_path(node.rig_folder)
        self._configuration = configuration_hash(node.rig_folder)
        self.notice: Fault | None = None
        if (chosen == REQUIRED or (chosen == AUTO and required)) and not self._passed():
            guard.power_on = PowerOnBound(cables)
            self.notice = Fault(FaultName.FIRST_POWER_ON, UNCHECKED)

    def look(self, resting: bool) -> Fault | None:
        """Lift the bound if the check has passed meanwhile; return what is to be said.

        Args:
            resting: whether no motor may move.
        """
        if self.notice is not None and resting and self._passed():
            self._guard.power_on = None
            self.notice = None
        return self.notice

    def _passed(self) -> bool:
        return passed_limbs(self._path, self._configuration) >= self._limbs
