# SPDX-License-Identifier: Apache-2.0
"""Rigid poses from measured points, with their covariance."""
