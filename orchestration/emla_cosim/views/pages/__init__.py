"""Self-contained HTML pages: what several kinds of reports have in common."""
