"""The optimised motion of the manipulator: solve, write and read its file, and draw it."""
