"""Modes of the rig, and the checks of the supervisor."""
