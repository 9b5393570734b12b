# SPDX-License-Identifier: Apache-2.0
"""Wrenches in a frame of the rig, as messages: desired ones are read, measured ones told."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from rclpy.node import Node

from cabols_control.checks import FloatArray
from cabols_control.ros.loop import Input
from cabols_control.ros.messages import topics
from cabols_control.ros.messages.layout import Layout, Record
from cabols_control.ros.node import ControlNode
from cabols_control.wrench_control.frames import WrenchFrames, place_frame, wrench_from_base
from cabols_control.wrench_control.uncertainty import WrenchUncertainty

FRAME_AT, TEXT_AT = 12, 16
"""Where length and text of a message's frame_id are, after the CDR header and the stamp [bytes]."""
LITTLE_ENDIAN = b"\x00\x01"
TOLD_EVERY = 10
"""Samples between two frame_wrench."""


class FramedInput(Input):
    """Input of wrenches in any of the rig's frames, each with a layout of its own.

    Attributes:
        frame: (1,) record of WRENCH_FRAME of the newest message; None for the rig's base frame.
        frame_name: its name.
    """

    def __init__(
        self,
        node: Node,
        topic: str,
        layout_of: Callable[[str], Layout],
        frames: WrenchFrames,
        lockstep: bool = False,
    ) -> None:
        """Subscribe.

        Args:
            node: owner.
            topic: its name in cabols_control.topics.
            layout_of: gives the layout of its messages in a frame.
            frames: of the rig.
            lockstep: whether the graph's clock waits for answers.
        """
        self._layouts: dict[bytes, tuple[str, Layout, Any]] = {}
        for name in frames.names:
            record = None if name == frames.names[0] else frames.record(name)
            self._layouts[name.encode()] = (name, layout_of(name), record)
        # An empty frame_id is the base's.
        self._base = self._layouts[frames.names[0].encode()]
        self._names = frames.names
        self.frame_name, layout, self.frame = self._base
        super().__init__(node, topic, layout, lockstep)

    def _accept(self, raw: bytes, info: dict[str, Any]) -> bool:
        name = _frame_of(raw)
        if name is None:
            # Another form of the message: its frame is read in the slow way.
            try:
                name = self._layout.strings(raw)["header.frame_id"].encode()
            except Exception:
                return super()._accept(raw, info)
        if name and name not in self._layouts:
            expected = ", ".join(self._names)
            self.raw = raw
            got = name.decode(errors="replace")
            self.error = f"{self.topic}: expected a frame out of {expected}, got {got}"
            return False
        before = self.frame_name, self._layout, self.frame
        self.frame_name, self._layout, self.frame = self._layouts.get(name, self._base)
        if super()._accept(raw, info):
            return True
        self.frame_name, self._layout, self.frame = before
        return False


class FramedWrenchInput(FramedInput):
    """Input of desired_wrench."""

    def __init__(self, node: ControlNode, frames: WrenchFrames) -> None:
        """Subscribe.

        Args:
            node: owner.
            frames: of the rig.
        """
        super().__init__(node, "desired_wrench", topics.wrench_layout, frames, node.lockstep)


def _frame_of(raw: bytes) -> bytes | None:
    """Return the frame_id of a serialised message with a header; None if it is not so simple."""
    if raw[:2] != LITTLE_ENDIAN:
        return None
    length = int.from_bytes(raw[FRAME_AT:TEXT_AT], "little")
    return bytes(raw[TEXT_AT : TEXT_AT + max(length - 1, 0)])


class FrameWrenchOutput:
    """Publishes desired and measured wrench in the frame of the desired one, every 10 ms.

    With them how well the measured one is known.
    """

    def __init__(
        self, node: ControlNode, frames: WrenchFrames, uncertainty: WrenchUncertainty
    ) -> None:
        """Advertise.

        Args:
            node: owner.
            frames: of the rig.
            uncertainty: of its measured wrenches.
        """
        self._uncertainty = uncertainty
        self._records: dict[str, Record] = {
            name: topics.frame_wrench_layout(name).record() for name in frames.names
        }
        # The base's wrenches are about the platform's origin already.
        self._frames = {name: frames.record(name) for name in frames.names[1:]}
        self._output = node.advertise_live("frame_wrench")
        self._count = 0
        self._desired, self._measured = np.zeros(6), np.zeros(6)

    def tell(
        self,
        stamp_ns: int,
        name: str,
        pose: tuple[FloatArray, FloatArray],
        acceleration: FloatArray,
        desired: FloatArray,
        measured: FloatArray,
    ) -> None:
        """Tell a sample's wrenches, at every tenth call.

        Args:
            stamp_ns: of the sample.
            name: of the frame.
            pose: (3,) position [m] and (3, 3) rotation of the platform at the sample, base frame.
            acceleration: (3,) of the platform at the sample, base axes [m/s^2].
            desired: (6,) about the platform's origin, base axes [N, N m].
            measured: (6,) likewise.
        """
        self._count += 1
        if self._count % TOLD_EVERY:
            return
        frame, uncertainty = self._frames.get(name), self._uncertainty
        # In each mode: the control law places the frames of what it follows alone.
        if frame is not None:
            place_frame(frame, *pose)
        known = uncertainty.of(name, frame, pose[1], acceleration, measured)
        if frame is not None:
            wrench_from_base(frame, desired, self._desired)
            wrench_from_base(frame, measured, self._measured)
            desired, measured = self._desired, self._measured
        record = self._records[name]
        record.stamp(stamp_ns)
        record["desired"][:], record["measured"][:] = desired, measured
        record["uncertainty"][:] = known
        self._output.publish(record.raw())
        self._output.copy()
