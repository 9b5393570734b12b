# SPDX-License-Identifier: Apache-2.0
"""Forward kinematics: the pose from the cables' lengths, with a proof that it is the only one."""

from .pose import FoundPose, PoseFinder, PoseRegion, PoseState, stretched_lengths

__all__ = ["FoundPose", "PoseFinder", "PoseRegion", "PoseState", "stretched_lengths"]
