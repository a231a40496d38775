"""Optimise the motion between two postures for the least actuator power: (11) to (15) of the paper."""
