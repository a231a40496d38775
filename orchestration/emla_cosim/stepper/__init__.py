"""The stepping loop in C: sources, records, and how it is built and loaded. It knows FMUs by address."""
