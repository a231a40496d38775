"""Columns that every table of variants has; nothing that varies and no figure can be called so."""

RESERVED = ("variant", "status", "problem", "end_s", "seed", "provenance", "time")
