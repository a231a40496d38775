"""A system prepared, simulated and recorded: options, scenarios, simulations, results as data."""
