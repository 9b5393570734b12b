"""The rig as a three-dimensional scene."""
