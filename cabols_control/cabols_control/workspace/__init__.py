"""Workspace of a cable robot: poses with the required wrenches and without interference."""
