"""Run variants: on this machine, or on a cluster."""
