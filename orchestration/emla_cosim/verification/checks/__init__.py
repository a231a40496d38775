"""The checks, one file for what belongs together."""
