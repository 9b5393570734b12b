"""ROS parameters that several nodes share, declared with description and bounds."""

from __future__ import annotations

from typing import Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.node import Node

from cabols_control.realtime.scheduling import Scheduling
from cabols_control.rig import Rig, load_rig
from cabols_control.rig_folder import BENCH, RigFolder, find_rig


def declare(
    node: Node,
    name: str,
    default: Any,
    description: str,
    bounds: tuple[float, float] | None = None,
) -> Any:
    """Declare a read-only parameter and return its value."""
    descriptor = ParameterDescriptor(description=description, read_only=True)
    if bounds is not None and isinstance(default, int):
        descriptor.integer_range = [
            IntegerRange(from_value=int(bounds[0]), to_value=int(bounds[1]), step=1)
        ]
    elif bounds is not None:
        descriptor.floating_point_range = [
            FloatingPointRange(from_value=float(bounds[0]), to_value=float(bounds[1]), step=0.0)
        ]
    return node.declare_parameter(name, default, descriptor).value


def declare_rig_folder(node: Node) -> RigFolder:
    """Declare the parameter that names the rig, and find its folder."""
    return find_rig(declare(node, "rig", BENCH, "name of an installed rig, or folder of a rig"))


def declare_rig(node: Node, folder: RigFolder) -> Rig:
    """Declare files that replace the rig's, and read what control needs."""
    return load_rig(
        folder,
        geometry=declare(node, "geometry_file", "", "YAML of the geometry; empty: the rig's"),
        limbs=declare(node, "limbs_file", "", "YAML of the limbs; empty: the rig's"),
        control=declare(node, "control_file", "", "YAML of the control; empty: the rig's"),
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
        fifo_priority=declare(
            node, "fifo_priority", 0, "SCHED_FIFO priority of all threads; 0: leave", (0, 99)
        ),
        lock_memory=declare(node, "lock_memory", False, "lock all pages in memory"),
        cpu=declare(node, "cpu", -1, "core to run on; -1: any", (-1, 1023)),
        cpu_latency_us=declare(
            node,
            "cpu_latency_us",
            -1,
            "us, longest wake-up of any core; 0: cores poll instead of sleeping, -1: leave",
            (-1, 1_000_000),
        ),
    )
