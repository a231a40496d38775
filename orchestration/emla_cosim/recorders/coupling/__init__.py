"""Estimate the coupling error of a run: the cost of exchanging values only at communication points."""
