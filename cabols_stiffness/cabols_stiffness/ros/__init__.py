"""What touches rclpy besides the nodes."""
