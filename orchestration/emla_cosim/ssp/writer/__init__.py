"""From a system of FMUs to an SSP that other tools run and draw."""
