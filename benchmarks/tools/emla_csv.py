"""EMLA-Cosim, this project's own master, with results.csv on disk."""

from functools import partial

from .emla import measure
from .worker import main

if __name__ == "__main__":
    main(partial(measure, to_disk=True), "emla-cosim")
