"""Elastic model of a robot, with prediction, compensation and compliance."""
