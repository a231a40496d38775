"""Verify FMI 2.0 FMUs of any tool, and report the findings."""
