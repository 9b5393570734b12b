# SPDX-License-Identifier: Apache-2.0
"""Measurements of a stiffness test, as arrays."""
