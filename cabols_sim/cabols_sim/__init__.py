"""Simulated rig: plant physics behind the real bridge."""
