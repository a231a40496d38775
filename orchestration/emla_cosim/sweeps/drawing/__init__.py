"""The pictures of sweeps, a module for each."""
