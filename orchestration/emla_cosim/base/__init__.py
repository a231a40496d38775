"""Modules that every other package builds on: errors, values, units, quantities, files and options."""
