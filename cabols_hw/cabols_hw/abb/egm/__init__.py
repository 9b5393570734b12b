# SPDX-License-Identifier: Apache-2.0
"""The robot's position stream (EGM): its packets, and how good it is."""
