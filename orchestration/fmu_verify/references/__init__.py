"""Read, follow and record the reference files of FMUs."""
