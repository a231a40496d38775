"""Analyses: questions about a scenario that take many runs, in one frame."""
