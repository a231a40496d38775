"""Joint files: a TOML file has all data of a joint, and one schema reads it."""
