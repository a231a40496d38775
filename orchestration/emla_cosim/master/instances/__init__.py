"""What is stepped: the instance interface, and FMUs behind it."""
