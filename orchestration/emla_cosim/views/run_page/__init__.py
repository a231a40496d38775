"""The page of a run: what came out, with curves to zoom into, and all that was set."""
