"""Commands that run the simulated rig through the real nodes."""
