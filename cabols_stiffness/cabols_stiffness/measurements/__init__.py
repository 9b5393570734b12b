"""What a stiffness test measured, as arrays."""
