# SPDX-License-Identifier: Apache-2.0
"""Where the robot's controller is heard from, and its password: its bridge's parameters."""

from __future__ import annotations

import ipaddress
import os
import socket
from pathlib import Path

from cabols_control.errors import ConfigError
from cabols_control.ros.node import ControlNode
from cabols_control.ros.parameters import declare, declare_row
from cabols_hw.abb.egm.reader import EgmReader
from cabols_hw.abb.robot import AbbAddress, AbbRobot
from cabols_hw.bringup_nodes import NODES as HW_NODES
from cabols_hw.robot.interface import Robot
from cabols_hw.ros.robot_stream import PoseSource
from cabols_hw.ur.robot import UrRobot

PASSWORD_VARIABLE = "CABOLS_ROBOT_PASSWORD"
ANY = "any"
ABB, UR = "abb", "ur"
MAKERS = (ABB, UR)


def egm_sender(node: ControlNode, robot_address: str) -> str:
    """Return the IP address that the position stream must come from; empty for any.

    Args:
        node: whose parameter names it.
        robot_address: of the controller.

    Raises:
        ConfigError: if it is none.
    """
    given = declare(
        node, "egm_address", "", "IP that EGM must come from; empty: robot_address; any: any"
    )
    address = given or robot_address
    if address == ANY:
        return ""
    try:
        return str(ipaddress.IPv4Address(socket.gethostbyname(address)))
    except OSError as error:
        raise ConfigError(
            f"egm_address: expected an IP address or 'any', got {address} ({error})"
        ) from error


def open_robot(
    node: ControlNode, address: str, speed: float, stale_s: float
) -> tuple[Robot, PoseSource]:
    """Return the robot that the parameter `robot_maker` names, and its stream.

    Args:
        node: whose parameters describe it.
        address: of its controller.
        speed: rate of its clock; 1 except for a simulated one in slow motion.
        stale_s: age at which a sample is of no use [s].

    Raises:
        ConfigError: if the maker is not known.
        RobotError: if the stream's port is taken, or an address cannot be used.
    """
    maker = declare_row(node, HW_NODES.argument("robot_maker"))
    if maker not in MAKERS:
        raise ConfigError(f"robot_maker: expected one of {', '.join(MAKERS)}, got {maker!r}")
    late_s = declare(node, "late_after", 0.03, "s, delay that counts as late", (0.001, 1.0))
    rtde_port = declare_row(node, HW_NODES.argument("rtde_port"))
    web_port = declare_row(node, HW_NODES.argument("rws_port"))
    egm_port = declare_row(node, HW_NODES.argument("egm_port"))
    url = declare(node, "rws_url", "", "replaces address and port; empty: made of them")
    controller = AbbAddress(
        url or f"http://{address}:{web_port}",
        declare(node, "user", "Default User", "of Robot Web Services"),
        read_password(node),
        declare(node, "rws_certificate", "", "PEM file for https; empty: any is taken"),
    )
    sender = egm_sender(node, address)
    if maker == UR:
        robot = UrRobot(address, rtde_port, late_after_s=late_s, clock_rate=speed)
        return robot, robot
    reader = EgmReader(egm_port, sender, late_s, speed, stale_s)
    return AbbRobot(controller, reader), reader


def read_password(node: ControlNode) -> str:
    """Return the controller's password, from a file or the environment.

    Args:
        node: whose parameter names the file.

    Raises:
        ConfigError: if the file cannot be read.
    """
    path = declare_row(node, HW_NODES.argument("password_file"))
    if not path:
        return os.environ.get(PASSWORD_VARIABLE, "robotics")
    try:
        password = Path(path).read_text(encoding="utf-8").splitlines()[0]
        if not password:
            raise IndexError("an empty line")
        return password
    except (OSError, UnicodeDecodeError, IndexError) as error:
        raise ConfigError(
            f"password_file: expected a file whose first line is the password, got {path} "
            f"({type(error).__name__})"
        ) from error
