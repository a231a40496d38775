"""Show runs to the user: terminal, plots, pages, animations, the output folder."""
