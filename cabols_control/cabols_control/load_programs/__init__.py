"""Wrenches over time, and whether the rig can give them."""
