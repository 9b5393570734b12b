"""Scheduling of real-time threads, and which kernels are compiled."""
