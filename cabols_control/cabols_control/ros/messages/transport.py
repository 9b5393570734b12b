# SPDX-License-Identifier: Apache-2.0
"""Transport between the nodes of one machine: UDP on loopback, no shared memory.

Fast DDS's shared memory (rmw_fastrtps's default on one machine) has a lock for each reading
process. A process that is killed while it holds the lock leaves it locked: every process that
publishes to it then stalls for a second, a bridge at 1 kHz too. UDP has no lock that another
process can hold. `make bench-transport` measures the cost of both.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

import rclpy
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.utilities import get_rmw_implementation_identifier

from cabols_control.bringup.network_names import domain_id
from cabols_control.configuration import packaged
from cabols_control.errors import ConfigError

RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
DECISIONS = (
    "ROS_STATIC_PEERS",
    "ROS_LOCALHOST_ONLY",
    "ROS_DISCOVERY_SERVER",
    "FASTRTPS_DEFAULT_PROFILES_FILE",
    "FASTDDS_DEFAULT_PROFILES_FILE",
    "CYCLONEDDS_URI",
)
"""Other variables by which somebody has decided whom a node finds."""
LOOPBACK = {
    "FASTRTPS_DEFAULT_PROFILES_FILE": str(packaged("cabols_control", "fastdds_loopback.xml"))
}
UDP = {"FASTDDS_BUILTIN_TRANSPORTS": "UDPv4"}
CHOICES = {"FASTDDS_DEFAULT_PROFILES_FILE": "", **LOOPBACK, **UDP}
"""Variables that choose a transport; one that is already set keeps its value."""


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


def discovery_variables(environment: Mapping[str, str]) -> dict[str, str]:
    """Return the variables that keep discovery on this machine, unless one of them is set.

    Whoever reaches the DDS domain can command the rig: other machines are a decision.

    Args:
        environment: what is set.
    """
    decided = any(environment.get(name) for name in (RANGE, *DECISIONS))
    return {} if decided else {RANGE: "LOCALHOST"}


def init(**arguments: Any) -> None:
    """Call rclpy.init() with these arguments, on this machine alone, without shared memory.

    Raises:
        ConfigError: if ROS cannot obey the arguments or the DDS domain of the environment.
    """
    if arguments.get("domain_id") is None:
        domain_id(os.environ)
    os.environ.update(discovery_variables(os.environ))
    os.environ.update(udp_variables(os.environ, get_rmw_implementation_identifier()))
    try:
        rclpy.init(**arguments)
    except rclpy_implementation.RCLError as error:
        # The sentence, without the places in rcl's sources that follow it.
        said = str(error).partition("failed to initialize rcl: ")[2] or str(error)
        raise ConfigError(said.partition(", at /")[0]) from error
