"""Components of a system as plain C for a target: a header, a source file, no allocation."""
