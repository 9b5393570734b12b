# SPDX-License-Identifier: Apache-2.0
"""Compiled kernels of the redundancy resolution, on one flat work array."""
