"""Scenarios: systems with the options to run them, as files. The built-in ones are files too."""
