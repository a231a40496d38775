"""FMUs as files: opened, checked, and their variables and units."""
