"""Columns of every table of variants. Factors and figures must not have these names."""

RESERVED = ("variant", "status", "problem", "end_s", "seed", "provenance", "time")
