"""Compare signals with references, within tubes in time and value."""
