"""A user's actuator: read from data-sheet values, checked, and converted to parameters."""
