"""Modes of the rig, and what the supervisor watches."""
