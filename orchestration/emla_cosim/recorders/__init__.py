"""Recorders take the rows of a run: files, memory, metrics, checkpoints, progress."""
