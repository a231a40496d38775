"""A whole system as one FMU, which steps its components as the master does."""
