"""Protection of results against crashes, signals and other processes."""
