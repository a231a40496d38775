"""The errors of benchmarks."""


class BenchmarkError(Exception):
    """A benchmark cannot continue; the message is for the user."""
