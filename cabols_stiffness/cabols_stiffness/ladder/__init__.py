# SPDX-License-Identifier: Apache-2.0
"""Ladder of models: from joint stiffness alone to an elastic arm, as far as held-out data pay."""
