"""Compiled kernels of the redundancy resolution, on one flat work array."""
