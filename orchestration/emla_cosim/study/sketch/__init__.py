"""Drawings of the manipulator: at instants along its path, and in motion."""
