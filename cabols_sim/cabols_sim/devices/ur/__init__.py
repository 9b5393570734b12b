# SPDX-License-Identifier: Apache-2.0
"""Simulated controller of Universal Robots: an RTDE server on the newest truth of the plant."""
