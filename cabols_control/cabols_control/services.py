# SPDX-License-Identifier: Apache-2.0
"""Services and actions of the graph, once: who serves and who calls them, beside topics.py."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Service:
    """One service or action.

    Attributes:
        name: relative to the namespace.
        servers: executables that serve it.
        clients: executables that call it.
        action: whether it is an action.
    """

    name: str
    servers: tuple[str, ...]
    clients: tuple[str, ...] = ("console",)
    action: bool = False


LIFECYCLE = (
    "change_state",
    "get_state",
    "get_available_states",
    "get_available_transitions",
    "get_transition_graph",
)
"""Services of a managed node, below its name; see cabols_hw.ros.managed_bridge."""
PLANT, BRIDGE, ROBOT = "plant", "q8_ati_bridge", "abb_tracker_bridge"
MANAGED = (PLANT, BRIDGE)
CAMPAIGN = "stiffness_campaign"
SERVICES = (
    Service("set_mode", ("supervisor",), ("console", "limb_controller", "load_program", CAMPAIGN)),
    Service("emergency_stop", ("supervisor",), ("console", CAMPAIGN)),
    Service("reset", ("supervisor",)),
    Service("tare", (PLANT, BRIDGE), ("console", CAMPAIGN)),
    Service("inject_fault", (PLANT,)),
    Service("record", ("recorder",)),
    Service("check_program", ("load_program",)),
    Service("correct_joints", ("compensation",)),
    Service("pause_stiffness_test", (CAMPAIGN,)),
    Service("resume_stiffness_test", (CAMPAIGN,)),
    Service("abort_stiffness_test", (CAMPAIGN,)),
    Service("report_stiffness_test", ("stiffness_identifier",), ("console", CAMPAIGN)),
    Service("commission_limb", ("limb_controller",), action=True),
    Service("run_program", ("load_program",), action=True),
    Service("move_to_configuration", (ROBOT,), ("console", CAMPAIGN), action=True),
    Service("follow_path", (ROBOT,), ("console", CAMPAIGN), action=True),
    Service("measure_reflector", (ROBOT,), ("console", CAMPAIGN), action=True),
    Service("run_stiffness_test", (CAMPAIGN,), action=True),
)
