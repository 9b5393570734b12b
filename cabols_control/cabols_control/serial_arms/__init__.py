# SPDX-License-Identifier: Apache-2.0
"""Robot arms of joints in a row, and the frames of a URDF."""
