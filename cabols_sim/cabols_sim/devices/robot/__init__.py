# SPDX-License-Identifier: Apache-2.0
"""The simulated robot: kinematics, flexible joints, smooth motions, the plant's target."""
