"""What came out of a run: signals and figures, pictures, files."""
