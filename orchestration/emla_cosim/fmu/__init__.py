"""FMU files: opening, checking and building them, their variables and units."""
