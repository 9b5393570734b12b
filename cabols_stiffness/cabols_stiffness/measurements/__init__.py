"""Measurements of a stiffness test, as arrays."""
