# SPDX-License-Identifier: Apache-2.0
"""Devices of the loading simulator and the bridge that paces its control loop."""
