"""The simulated system: components, connections, start values, power bonds and faults."""
