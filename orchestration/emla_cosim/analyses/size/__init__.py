"""Sizing: whether actuators do the job that a scenario requires of them, continuously and at peak."""
