"""Compare controllers: the same scenarios under the same conditions, with a row of figures for each."""
