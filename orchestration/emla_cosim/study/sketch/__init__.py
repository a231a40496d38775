"""The manipulator drawn: at instants along its path, and moving."""
