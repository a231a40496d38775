"""Identification: parameters of a system from measured data, with the certainty of each."""
