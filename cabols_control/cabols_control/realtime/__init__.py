# SPDX-License-Identifier: Apache-2.0
"""Scheduling of real-time threads, and a count of compiled kernels."""
