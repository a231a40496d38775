"""The master: FMU instances, the algorithms that step them, and the loop over time."""
