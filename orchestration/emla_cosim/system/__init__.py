"""What is simulated: components, connections, parameter values; and the scenarios built of them."""
