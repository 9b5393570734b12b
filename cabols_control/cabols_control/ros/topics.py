"""Names, types and layouts of the topics at the control rate."""

from __future__ import annotations

from cabols_msgs.msg import (
    CampaignStatus,
    DesiredTension,
    LimbState,
    LoopStatus,
    Mode,
    MotorCurrent,
    ReflectorMeasurement,
    StiffnessEstimate,
    StiffnessLoad,
    TensionCommand,
)
from geometry_msgs.msg import PoseStamped, WrenchStamped
from sensor_msgs.msg import JointState

from cabols_control.geometry import RigGeometry
from cabols_control.ros.layout import Layout

NAMESPACE = "/cabols"

LIMB_ARRAYS = (
    "limb",
    "wound_length",
    "elongation",
    "tension",
    "current",
    "switch_closed",
    "zeroed",
)
TYPES: dict[str, type] = {
    "limb_state": LimbState,
    "wrench": WrenchStamped,
    "motor_current": MotorCurrent,
    "tension_command": TensionCommand,
    "desired_wrench": WrenchStamped,
    "desired_tension": DesiredTension,
    "platform_pose": PoseStamped,
    "mode": Mode,
    "loop_status": LoopStatus,
    "true_limb_state": LimbState,
    "true_wrench": WrenchStamped,
    "joint_states": JointState,
    "reflector_measurement": ReflectorMeasurement,
    "stiffness_load": StiffnessLoad,
    "stiffness_estimate": StiffnessEstimate,
    "campaign_status": CampaignStatus,
}
"""Every topic of the bench, relative to the namespace."""

RECORDED = tuple(name for name in TYPES if not name.startswith("true_"))
"""What is recorded unless told otherwise: what a real rig has, too."""

CONTROL_TOPICS = (
    "limb_state",
    "wrench",
    "motor_current",
    "tension_command",
    "desired_wrench",
    "desired_tension",
    "platform_pose",
    "true_limb_state",
    "true_wrench",
    "joint_states",
)
"""Topics with control_qos."""

LATCHED_TOPICS = ("mode", "stiffness_estimate", "campaign_status")
"""Topics with latched_qos: who comes late must know them at once."""


def limb_state_layout(geometry: RigGeometry) -> Layout:
    """LimbState of all cables."""
    lengths = dict.fromkeys(LIMB_ARRAYS, geometry.cables)
    return Layout(LimbState, lengths, {"header.frame_id": geometry.base_frame})


def wrench_layout(frame: str) -> Layout:
    """WrenchStamped in a frame; field `wrench` (6,) force [N], torque [N m]."""
    return Layout(
        WrenchStamped,
        strings={"header.frame_id": frame},
        joined={"wrench": ("wrench.force.x", 6)},
    )


def tension_command_layout(geometry: RigGeometry) -> Layout:
    """TensionCommand for all cables."""
    n = geometry.cables
    return Layout(
        TensionCommand, {"limb": n, "tension": n}, {"header.frame_id": geometry.base_frame}
    )


def desired_tension_layout(geometry: RigGeometry) -> Layout:
    """DesiredTension for all cables."""
    n = geometry.cables
    return Layout(DesiredTension, {"limb": n, "tension": n})


def motor_current_layout(geometry: RigGeometry, limbs: int) -> Layout:
    """MotorCurrent for a number of limbs."""
    lengths = {"limb": limbs, "current": limbs, "saturated": limbs}
    return Layout(MotorCurrent, lengths, {"header.frame_id": geometry.base_frame})


def pose_layout(geometry: RigGeometry) -> Layout:
    """PoseStamped in the base frame; field `pose` (7,) position [m], quaternion x y z w."""
    return Layout(
        PoseStamped,
        strings={"header.frame_id": geometry.base_frame},
        joined={"pose": ("pose.position.x", 7)},
    )


def mode_layout(reason: str) -> Layout:
    """Mode with a reason."""
    return Layout(Mode, strings={"reason": reason})


def loop_status_layout(node: str, reason: str) -> Layout:
    """LoopStatus of a node with a reason."""
    return Layout(LoopStatus, strings={"node": node, "reason": reason})
