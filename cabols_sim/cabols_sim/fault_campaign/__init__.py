# SPDX-License-Identifier: Apache-2.0
"""The fault campaign: every fault, many times, in the loaded rig; detection and its delay."""
