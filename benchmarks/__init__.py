"""Measure how fast several tools run the same FMUs; see README.md in this folder."""
