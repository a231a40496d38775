"""What a run leaves behind: rows on disk, metrics, plots, and a record of how it was made."""
