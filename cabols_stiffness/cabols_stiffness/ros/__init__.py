"""Parts besides the nodes that use rclpy."""
