"""`python -m emla_cosim` is `emla`."""

from .cli.program import main

main()
