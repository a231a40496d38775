"""Gains found by optimisation: cases that are simulated, seeds to train on and others to validate."""
