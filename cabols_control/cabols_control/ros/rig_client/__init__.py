# SPDX-License-Identifier: Apache-2.0
"""The client of a running rig, for scripts and for cabols' own tools: RigClient."""

from cabols_control.ros.rig_client.client import RigClient
from cabols_control.ros.rig_client.errors import (
    AbandonedError,
    ActionFailedError,
    RefusedError,
    RigError,
    RigFaultError,
    RigTimeoutError,
)
from cabols_control.ros.rig_client.running_action import RunningAction

__all__ = [
    "AbandonedError",
    "ActionFailedError",
    "RefusedError",
    "RigClient",
    "RigError",
    "RigFaultError",
    "RigTimeoutError",
    "RunningAction",
]
