"""Where the robot's controller is heard from, and its password: its bridge's parameters."""

from __future__ import annotations

import ipaddress
import os
import socket
from pathlib import Path

from cabols_control.errors import ConfigError
from cabols_control.ros.node import ControlNode
from cabols_control.ros.parameters import declare

PASSWORD_VARIABLE = "CABOLS_ROBOT_PASSWORD"
ANY = "any"


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


def read_password(node: ControlNode) -> str:
    """Return the controller's password, from a file or the environment.

    Args:
        node: whose parameter names the file.

    Raises:
        ConfigError: if the file cannot be read.
    """
    path = declare(
        node,
        "password_file",
        "",
        f"its first line is the password; empty: ${PASSWORD_VARIABLE}, or ABB's default",
    )
    if not path:
        return os.environ.get(PASSWORD_VARIABLE, "robotics")
    try:
        return Path(path).read_text(encoding="utf-8").splitlines()[0]
    except (OSError, UnicodeDecodeError, IndexError) as error:
        raise ConfigError(
            f"password_file: expected a file whose first line is the password, got {path} "
            f"({type(error).__name__})"
        ) from error
