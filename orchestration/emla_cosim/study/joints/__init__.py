"""Joint files: one TOML file has all of a joint, and one schema reads it."""
