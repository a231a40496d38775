"""The energies of power bonds: what the coupling creates or destroys there."""
