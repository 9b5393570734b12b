"""Rigid poses from measured points, with their covariance."""
