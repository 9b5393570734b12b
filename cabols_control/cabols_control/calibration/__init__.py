# SPDX-License-Identifier: Apache-2.0
"""Self-calibration: the rig's true points, pulleys, stiffnesses and sensor from its own data."""
