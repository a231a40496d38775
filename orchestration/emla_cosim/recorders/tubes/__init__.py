"""Signals compared with references: tubes in time and value around them."""
