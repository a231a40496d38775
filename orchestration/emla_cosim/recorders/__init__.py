"""What takes the rows of a run while it goes on: files, memory, metrics, checkpoints, progress."""
