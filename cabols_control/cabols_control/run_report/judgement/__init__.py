# SPDX-License-Identifier: Apache-2.0
"""A run's figures, and what is allowed of them."""
