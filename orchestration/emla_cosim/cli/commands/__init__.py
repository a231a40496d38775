"""The commands of `emla`, a module for each."""
