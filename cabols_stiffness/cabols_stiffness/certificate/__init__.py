# SPDX-License-Identifier: Apache-2.0
"""Uncertainty budget, measured compliance, and the certificate that holds them."""
