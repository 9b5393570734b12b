"""Robots of Universal Robots, over RTDE (Real-Time Data Exchange)."""
