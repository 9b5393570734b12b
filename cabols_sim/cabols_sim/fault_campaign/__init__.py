"""The fault campaign: every fault, many times, in the loaded rig; what was found and how fast."""
