"""Conversion of SSP files from any tool to a flat system of FMUs."""
