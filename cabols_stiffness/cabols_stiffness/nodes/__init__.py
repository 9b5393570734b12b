"""Thin rclpy nodes."""
