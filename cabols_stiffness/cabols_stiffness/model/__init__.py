"""Elastic model of a robot, and what follows from it."""
