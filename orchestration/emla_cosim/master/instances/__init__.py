"""What is stepped: the slave interface, and FMUs behind it."""
