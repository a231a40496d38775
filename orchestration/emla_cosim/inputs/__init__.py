"""Data that drive signals: read from files or frames, and inserted into a system as FMUs."""
