"""From a desired and a measured wrench to the limbs' tensions."""
