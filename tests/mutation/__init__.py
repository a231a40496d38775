"""Mutation testing by hand: `python -m tests.mutation --help`; tests/reliability.md explains it."""
