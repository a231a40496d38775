"""Mending the text of FMUs: only what has one remedy, and never a binary."""
