"""What keeps a crash, a signal or another process from costing results."""
