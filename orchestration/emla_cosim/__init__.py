"""Systems of FMUs, the master that runs them, scenarios, metrics, plots and the `emla` command."""
