# SPDX-License-Identifier: Apache-2.0
"""Wrenches over time, and whether the rig can give them."""
