"""From an SSP, whoever wrote it, to a flat system of FMUs."""
