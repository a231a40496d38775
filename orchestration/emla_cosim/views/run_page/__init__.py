"""The page of a run: results, curves to zoom into, and all settings."""
