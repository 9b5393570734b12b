"""Physics of the simulated rig behind a simulated card."""
