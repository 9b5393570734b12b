"""Joint stiffness of robots from the deflections under measured wrenches."""
