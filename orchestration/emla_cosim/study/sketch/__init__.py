"""Drawings of machines: at instants along its path, and in motion."""
