"""Co-simulation algorithms: the order of exchanges and calls within a step."""
