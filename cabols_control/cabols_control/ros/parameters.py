# SPDX-License-Identifier: Apache-2.0
"""ROS parameters that several nodes share, declared with description and bounds."""

from __future__ import annotations

from typing import Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.node import Node

from cabols_control.bringup.specs import Argument
from cabols_control.bringup_nodes import NODES as CONTROL_NODES
from cabols_control.realtime.scheduling import Scheduling
from cabols_control.rig import Rig, load_rig
from cabols_control.rig_folder import RigFolder, find_rig


def declare(
    node: Node,
    name: str,
    default: Any,
    description: str,
    bounds: tuple[float, float] | None = None,
) -> Any:
    """Declare a read-only parameter and return its value."""
    descriptor = ParameterDescriptor(description=description, read_only=True)
    if bounds is not None and isinstance(default, list):
        bounds = None  # ROS bounds numbers alone; launch has checked each of them.
    if bounds is not None and isinstance(default, int):
        descriptor.integer_range = [
            IntegerRange(from_value=int(bounds[0]), to_value=int(bounds[1]), step=1)
        ]
    elif bounds is not None:
        descriptor.floating_point_range = [
            FloatingPointRange(from_value=float(bounds[0]), to_value=float(bounds[1]), step=0.0)
        ]
    return node.declare_parameter(name, default, descriptor).value


def declare_row(node: Node, row: Argument) -> Any:
    """Declare the parameter that a launch argument is of this node, and return its value.

    Args:
        node: that has it.
        row: of the table of the node's package.
    """
    unit = f" [{row.unit}]" if row.unit else ""
    text = f"{row.description}{unit}"
    return declare(node, row.parameter or row.name, row.default, text, row.bounds)


def declare_rig_folder(node: Node) -> RigFolder:
    """Declare the parameter that names the rig, and find its folder."""
    return find_rig(declare_row(node, CONTROL_NODES.argument("rig")))


def declare_rig(node: Node, folder: RigFolder) -> Rig:
    """Declare files that replace the rig's, and read what control needs."""
    return load_rig(
        folder,
        geometry=declare_row(node, CONTROL_NODES.argument("geometry_file")),
        limbs=declare_row(node, CONTROL_NODES.argument("limbs_file")),
        control=declare_row(node, CONTROL_NODES.argument("control_file")),
    )


def declare_lockstep(node: Node) -> bool:
    """Declare whether the clock waits for every answer (simulation only)."""
    return bool(
        declare(node, "lockstep", False, "true: deterministic, the plant waits for every answer")
    )


def declare_robot(node: Node) -> bool:
    """Declare whether a robot carries the platform.

    The robot sends its pose at its own pace; even in lockstep the clock waits only for the control
    path.
    """
    return bool(declare(node, "robot", False, "a robot carries the platform, at its own pace"))


def declare_scheduling(node: Node) -> Scheduling:
    """Declare the scheduling that the control thread requests from the kernel."""
    return Scheduling(
        fifo_priority=declare_row(node, CONTROL_NODES.argument("fifo_priority")),
        lock_memory=declare_row(node, CONTROL_NODES.argument("lock_memory")),
        cpu=declare(node, "cpu", -1, "core to run on; -1: any", (-1, 1023)),
        cpu_latency_us=declare_row(node, CONTROL_NODES.argument("cpu_latency_us")),
    )
