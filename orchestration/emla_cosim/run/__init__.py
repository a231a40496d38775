"""Prepare, simulate and record a system: options, scenarios, simulations, results as data."""
