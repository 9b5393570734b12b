# SPDX-License-Identifier: Apache-2.0
"""Parts besides the nodes that use rclpy."""
