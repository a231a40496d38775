"""Inspect an FMU, a package or a scenario: FMUs, variables, connections, and what can be set."""
