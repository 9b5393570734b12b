# SPDX-License-Identifier: Apache-2.0
"""What touches rclpy besides the nodes."""
