# SPDX-License-Identifier: Apache-2.0
"""Robots of Universal Robots, over RTDE (Real-Time Data Exchange)."""
