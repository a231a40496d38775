"""The optimised motion of the manipulator: found, written to a file, read back, and drawn."""
