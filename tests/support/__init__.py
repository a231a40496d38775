"""What tests, benchmarks and documents share: models, hosts, oracles, and ways to break things."""
