"""Scenarios: systems and how they are run, as files; the built-in ones are files too."""
