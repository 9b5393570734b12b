# SPDX-License-Identifier: Apache-2.0
"""How a node starts, keeps its role and its time, and ends."""
