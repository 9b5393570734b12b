# SPDX-License-Identifier: Apache-2.0
"""What the rig asks of any robot, whoever made it."""
