"""Identified stiffness in the files of simulators: URDF, SDF, MuJoCo."""
