"""A node's own state: diagnostics, durations, log lines."""
