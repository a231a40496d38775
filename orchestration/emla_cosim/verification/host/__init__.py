"""Calls of an FMU under examination, each noted before it is made."""
