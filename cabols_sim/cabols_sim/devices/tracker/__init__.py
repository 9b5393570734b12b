"""The simulated laser tracker: its physics, and a server that speaks tracker.proto."""
