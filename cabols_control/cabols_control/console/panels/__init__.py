"""The panels of the operator's page."""
