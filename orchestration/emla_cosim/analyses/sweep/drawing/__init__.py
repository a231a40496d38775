"""Draw the pictures of sweeps, one module for each."""
