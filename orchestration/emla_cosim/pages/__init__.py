"""Self-contained HTML pages: the common parts of all reports."""
