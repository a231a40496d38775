"""Co-simulation algorithms: what is exchanged when, within one step."""
