# SPDX-License-Identifier: Apache-2.0
"""Identified stiffness in the files of simulators: URDF, SDF, MuJoCo."""
