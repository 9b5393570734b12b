# SPDX-License-Identifier: Apache-2.0
"""The rig as a three-dimensional scene."""
