# SPDX-License-Identifier: Apache-2.0
"""Poses of the platform over time: between and after measurements, filtered."""
