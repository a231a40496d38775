"""Controllers side by side: the same scenarios under the same circumstances, a row of figures for each."""
