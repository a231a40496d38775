"""Data that drive signals: read from files or frames, and put into a system as FMUs made of them."""
