"""Mutation testing by hand: `python -m tests.mutation --help`; docs/reliability.md explains it."""
