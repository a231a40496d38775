"""Sweeps: plan many variants of one scenario, run them, and evaluate them."""
