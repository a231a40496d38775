"""Call an FMU under examination. Every call is noted first, so that a crash can be attributed."""
