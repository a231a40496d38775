"""Conversion of a system of FMUs to an SSP that other tools can run and draw."""
