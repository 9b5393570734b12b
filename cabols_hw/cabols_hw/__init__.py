"""Devices of the loading simulator and the bridge that paces its control loop."""
