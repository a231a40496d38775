"""The FMUs' own calls with the inputs of a run before, and nothing between them: what no tool can save."""

from ..job import Job
from .c_loop import run_loop
from .worker import Measurement, main


def measure(job: Job) -> Measurement:
    """Run the job for its inputs, and time the calls alone."""
    return run_loop(job, "replay")


if __name__ == "__main__":
    main(measure)
