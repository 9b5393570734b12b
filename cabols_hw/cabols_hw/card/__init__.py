"""The data acquisition card: configuration, wiring, back ends."""
