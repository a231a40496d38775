"""The commands of `emla`, one module each."""
