"""Kinds of distributions of a factor."""
