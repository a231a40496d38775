"""Frequency responses and stability margins at a time of a run."""
