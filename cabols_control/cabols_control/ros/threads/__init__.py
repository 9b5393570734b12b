"""Threads of a node beside its executor, and work handed to it."""
