"""System Structure and Parameterization (SSP 1.0 and 2.0): systems as documents that other tools read."""
