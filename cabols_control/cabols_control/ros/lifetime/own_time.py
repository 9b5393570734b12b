# SPDX-License-Identifier: Apache-2.0
"""No node of the rig follows /clock: not from its start, and not when it is asked to later."""

from __future__ import annotations

from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter

from cabols_control.errors import ConfigError

PARAMETER = "use_sim_time"
WHY = (
    f"{PARAMETER}: expected false, got true: time-outs and stamps follow the bridge's samples, in "
    "slow motion and in lockstep too, and not /clock"
)


def keep_own_time(node: Node) -> None:
    """Refuse the parameter use_sim_time; where nobody publishes /clock, timers would stand still.

    Args:
        node: that has just been made.

    Raises:
        ConfigError: if it was started with use_sim_time.
    """
    if node.get_parameter(PARAMETER).value:
        raise ConfigError(f"{WHY}; leave it out")
    node.add_on_set_parameters_callback(_judge)


def _judge(asked: list[Parameter]) -> SetParametersResult:
    wrong = any(each.name == PARAMETER and each.value is not False for each in asked)
    return SetParametersResult(successful=not wrong, reason=WHY if wrong else "")
