"""FMU instances, in this process or in processes of their own."""
