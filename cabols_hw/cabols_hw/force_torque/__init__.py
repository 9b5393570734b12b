# SPDX-License-Identifier: Apache-2.0
"""The force/torque sensor: calibration, tare, weight of the tool."""
