# SPDX-License-Identifier: Apache-2.0
"""Nodes and arguments of this package: stiffness campaigns."""

from __future__ import annotations

from cabols_control.bringup.specs import Argument, NodeSpec, PackageNodes, Role
from cabols_control.bringup_nodes import OF_EVERY_LOOP

IDENTIFIER = NodeSpec(
    "cabols_stiffness",
    "stiffness_identifier",
    ("stiffness_load", "campaign_status"),
    ("stiffness_estimate", "loop_status"),
    role=Role.CAMPAIGN,
    takes=(
        *OF_EVERY_LOOP,
        "other_cpu",
    ),
    fifo_below=2,
)
CAMPAIGN = NodeSpec(
    "cabols_stiffness",
    "stiffness_campaign",
    ("mode", "limb_state", "wrench", "joint_states", "platform_pose", "stiffness_estimate"),
    ("desired_tension", "stiffness_load", "campaign_status", "loop_status"),
    role=Role.CAMPAIGN,
    takes=(
        *OF_EVERY_LOOP,
        "other_cpu",
        "campaign_file",
        "campaign_folder",
    ),
    fifo_below=2,
)
ARGUMENTS = (
    Argument("campaign", False, "with the nodes of stiffness campaigns"),
    Argument("campaign_file", "", "campaign.yaml of campaigns that name none"),
    Argument("campaign_folder", "", "folder of campaigns that name none"),
)
NODES = PackageNodes((IDENTIFIER, CAMPAIGN), ARGUMENTS)
