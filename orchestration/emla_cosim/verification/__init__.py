"""Is this FMU still right: checks of any FMI 2.0 FMU, and what they found."""
