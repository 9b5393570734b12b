# SPDX-License-Identifier: Apache-2.0
"""Joint stiffness from measured deflections."""
