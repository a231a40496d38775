"""What the exchange of values between components cost, from every communication point of a run."""
