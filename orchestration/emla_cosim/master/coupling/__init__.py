"""Estimate the coupling error of a run: the error of exchanging values only at communication points."""
