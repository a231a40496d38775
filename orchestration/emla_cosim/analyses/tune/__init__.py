"""Tune gains by optimisation: simulate cases, train with some seeds, and validate with others."""
