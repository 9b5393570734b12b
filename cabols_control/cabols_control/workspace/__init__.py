"""Workspace of a cable robot: where it can give the required wrenches without touching itself."""
