# SPDX-License-Identifier: Apache-2.0
"""Forms of names in a network and in a graph, as a person types them."""

from __future__ import annotations

import ipaddress
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from cabols_control.errors import ConfigError

DOMAIN = "ROS_DOMAIN_ID"
MAX_DOMAIN = 232
"""Highest of which DDS can compute ports."""
MAX_NAMESPACE = 200
"""Letters of a namespace; DDS takes topics of 255 in all."""
HOST = re.compile(r"[A-Za-z0-9](?:[A-Za-z0-9.-]*[A-Za-z0-9])?")
NAMESPACE = re.compile(r"(/[A-Za-z_][A-Za-z0-9_]*)+")


@dataclass(frozen=True)
class Form:
    """What a text must look like.

    Attributes:
        fits: whether a text does.
        words: for people.
    """

    fits: Callable[[str], bool]
    words: str


def matches(pattern: str) -> Callable[[str], bool]:
    """Return whether a whole text matches a pattern, as a function of the text."""
    compiled = re.compile(pattern)
    return lambda name: compiled.fullmatch(name) is not None


def is_namespace(name: str) -> bool:
    """Whether ROS takes it for a namespace, with room for the topics in it."""
    return NAMESPACE.fullmatch(name) is not None and len(name) <= MAX_NAMESPACE


def is_host(name: str) -> bool:
    """Whether it is an IPv4 address or a host's name; digits and dots alone are an address."""
    if not HOST.fullmatch(name):
        return False
    if re.fullmatch(r"[0-9.]+", name):
        return _is_address(name, 4)
    return all(len(part) in range(1, 64) for part in name.split("."))


def is_ipv6(name: str) -> bool:
    """Whether it is an IPv6 address."""
    return _is_address(name, 6)


def _is_address(name: str, version: int) -> bool:
    try:
        return ipaddress.ip_address(name).version == version
    except ValueError:
        return False


def is_host_and_port(name: str) -> bool:
    """Whether it is host:port, the port from 1 to 65535."""
    host, _, port = name.rpartition(":")
    digits = re.fullmatch(r"[0-9]{1,5}", port) is not None
    return is_host(host) and digits and int(port) in range(1, 65536)


def domain_id(environment: Mapping[str, str]) -> int:
    """Return the DDS domain that an environment names; 0 where it names none.

    Args:
        environment: variables.

    Raises:
        ConfigError: if it is none; ROS would end in a traceback, or take -1 for 0.
    """
    name = environment.get(DOMAIN, "") or "0"
    if not re.fullmatch(r"[0-9]{1,3}", name) or int(name) > MAX_DOMAIN:
        raise ConfigError(f"{DOMAIN}: expected a whole number from 0 to {MAX_DOMAIN}, got {name!r}")
    return int(name)
