"""The safety envelope, and the guard that acts on it."""
