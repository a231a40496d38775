"""What a person sees of a run: terminal, plots, pages, animations, the output folder."""
