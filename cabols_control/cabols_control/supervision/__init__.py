# SPDX-License-Identifier: Apache-2.0
"""Modes of the rig, and the checks of the supervisor."""
