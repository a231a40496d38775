"""`python -m emla_cosim` is `emla`."""

from .program import main

main()
