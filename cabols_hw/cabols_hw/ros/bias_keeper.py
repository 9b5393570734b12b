# SPDX-License-Identifier: Apache-2.0
"""The bridge's share in the sensor's bias: its file, and what to say about bias and held loads."""

from __future__ import annotations

import sys
import time
from dataclasses import replace
from pathlib import Path

from geometry_msgs.msg import WrenchStamped

from cabols_control.errors import CabolsError, ConfigError
from cabols_control.ros.messages.qos import topic_qos
from cabols_control.ros.node import ControlNode
from cabols_control.ros.parameters import declare_row
from cabols_control.ros.threads.executor_thread import hand_over
from cabols_control.supervision.faults import Fault, FaultName
from cabols_hw.bridge.bridge import Bridge
from cabols_hw.bridge.held_load import held_load
from cabols_hw.bringup_nodes import NODES as HW_NODES
from cabols_hw.card.config import CardConfig
from cabols_hw.force_torque.sensor_bias import SensorBias, bias_path, load_bias, save_bias


class BiasKeeper:
    """Gives the bridge the bias of before its start, and keeps each new one that was proven."""

    def __init__(self, node: ControlNode, bridge: Bridge, card: CardConfig, keeps: bool) -> None:
        """Declare the file; use the bias in it.

        Args:
            node: of the bridge.
            bridge: that uses the bias.
            card: names the sensor.
            keeps: whether there is a file where the parameter names none.
        """
        self._node, self._bridge = node, bridge
        given = declare_row(node, HW_NODES.argument("bias_file"))
        own = bias_path(card.sensor_serial) if keeps else None
        self._path = Path(given) if given else own
        self._doubt = ""
        self._adopt(card.sensor_serial)
        self._kept = bridge.sensor_tare.proven
        self._tare = node.create_publisher(WrenchStamped, "sensor_tare", topic_qos("sensor_tare"))
        self._told: SensorBias | None = None

    def _adopt(self, serial: str) -> None:
        if self._path is None:
            return
        try:
            bias = load_bias(self._path, serial)
        except ConfigError as error:
            # The bridge runs without: it then knows no wrench before a tare, and says so.
            self._node.get_logger().error(str(error))
            return
        if bias is not None:
            # An old one still bounds the wrench; nothing is loaded by it.
            self._doubt = bias.doubt(time.time())
            self._bridge.adopt_bias(bias)

    def look(self, resting: bool) -> Fault | None:
        """Keep a new bias; return what is to be said though nothing is faulty.

        Args:
            resting: whether no motor may move.
        """
        tare = self._bridge.sensor_tare
        bias = tare.proven
        if bias is not None and bias is not self._kept:
            self._kept = bias
            if self._path is not None:
                # The loop must not wait for a disk.
                hand_over(self._node, lambda: self._save(bias))
        if tare.bias is not self._told:
            self._told = tare.bias
            hand_over(self._node, self._tell_tare)
        if not tare.judged:
            return None
        if tare.bias is None:
            return Fault(FaultName.NOT_TARED, tare.refusal)
        if self._doubt and tare.proven is None:
            return Fault(FaultName.NOT_TARED, self._doubt)
        held = held_load(self._bridge) if resting else ""
        if held:
            return Fault(FaultName.LOAD_HELD, held)
        return Fault(FaultName.TARE_REFUSED, tare.refusal) if tare.refusal else None

    def tell_held(self) -> None:
        """Print what the gears hold while no process watches it."""
        if held := held_load(self._bridge):
            print(f"the bridge ends: {held}", file=sys.stderr, flush=True)

    def _tell_tare(self) -> None:
        """Tell what the tool weighed at the tare; NaN without one."""
        message = WrenchStamped()
        message.header.frame_id = self._node.rig.geometry.platform_frame
        values = [float(value) for value in self._bridge.tare_load()]
        force, torque = message.wrench.force, message.wrench.torque
        force.x, force.y, force.z, torque.x, torque.y, torque.z = values
        self._tare.publish(message)

    def _save(self, bias: SensorBias) -> None:
        assert self._path is not None
        try:
            # The rig's clock need not be the computer's.
            save_bias(self._path, replace(bias, time_ns=time.time_ns()))
        except CabolsError as error:
            self._node.get_logger().error(str(error))
