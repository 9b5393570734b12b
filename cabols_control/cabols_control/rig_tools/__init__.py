"""Makes, migrates and describes the folders of rigs."""
