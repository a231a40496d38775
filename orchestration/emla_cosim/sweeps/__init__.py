"""Many variants of one scenario: planned, run side by side on Dask, and looked at."""
