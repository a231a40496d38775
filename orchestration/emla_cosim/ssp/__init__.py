"""System structures of the SSP standard: reading and writing."""
