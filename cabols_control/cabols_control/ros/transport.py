"""How nodes of one machine talk to each other: by UDP on loopback, not through shared memory.

Fast DDS's shared memory (rmw_fastrtps's default on one machine) has a lock for each process that
reads. Who is killed while holding it leaves it locked: every process that publishes to it then
stands still for a second, a bridge at 1 kHz too. UDP has no lock that others can hold. What both
cost: `make bench-transport`.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

import rclpy
from rclpy.utilities import get_rmw_implementation_identifier

from cabols_control.configuration import packaged

RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
LOOPBACK = {
    "FASTRTPS_DEFAULT_PROFILES_FILE": str(packaged("cabols_control", "fastdds_loopback.xml"))
}
UDP = {"FASTDDS_BUILTIN_TRANSPORTS": "UDPv4"}
CHOICES = {"FASTDDS_DEFAULT_PROFILES_FILE": "", **LOOPBACK, **UDP}
"""Who sets one of these otherwise has chosen the transport, and keeps it."""


def udp_variables(environment: Mapping[str, str], rmw: str) -> dict[str, str]:
    """Return the variables that keep a process out of shared memory.

    Args:
        environment: what is set.
        rmw: identifier of the ROS middleware; only rmw_fastrtps needs any.
    """
    chosen = any(environment.get(name, "") not in ("", ours) for name, ours in CHOICES.items())
    if chosen or not rmw.startswith("rmw_fastrtps"):
        return {}
    if environment.get(RANGE) == "LOCALHOST" and not environment.get("ROS_STATIC_PEERS"):
        # At LOCALHOST rmw_fastrtps adds shared memory, whatever FASTDDS_BUILTIN_TRANSPORTS says.
        return {RANGE: "SYSTEM_DEFAULT", **LOOPBACK}
    return UDP


def init(**arguments: Any) -> None:
    """Do what rclpy.init() does, with its arguments, for a process that stays out of it."""
    os.environ.update(udp_variables(os.environ, get_rmw_implementation_identifier()))
    rclpy.init(**arguments)
