"""The force/torque sensor: calibration, tare, weight of the tool."""
