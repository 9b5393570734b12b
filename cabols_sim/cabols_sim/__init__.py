# SPDX-License-Identifier: Apache-2.0
"""Simulated rig: plant physics behind the real bridge."""
