"""Start times of scheduled events."""

NEVER = 1e9
"""Start in s of events that are not scheduled: later than the end of any run."""
