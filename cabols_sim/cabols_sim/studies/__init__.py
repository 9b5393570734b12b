"""Studies by computation: dynamics, vibration, gains."""
