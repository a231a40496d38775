"""What ends a benchmark with one sentence."""


class BenchmarkError(Exception):
    """A sentence for the user."""
