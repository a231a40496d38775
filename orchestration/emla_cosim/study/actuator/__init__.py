"""One's own actuator, entered once: read as its data sheets print it, checked, and made parameters of."""
