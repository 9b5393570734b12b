"""Scheduling of real-time threads, and a count of compiled kernels."""
