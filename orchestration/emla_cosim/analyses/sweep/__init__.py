"""Sweeps: plan many variants of one scenario, run them on Dask, and evaluate them."""
