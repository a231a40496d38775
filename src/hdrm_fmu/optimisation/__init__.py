"""The motion between two postures that takes the least actuator power: (11) to (15) of the paper."""
