"""Times at which something begins."""

NEVER = 1e9
"""Start in s of what does not happen unless somebody says when: beyond any run."""
