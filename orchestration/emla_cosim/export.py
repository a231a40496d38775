"""A system written as an SSP package."""

from pathlib import Path

from .experiment import run_times
from .options import Options
from .preparation import prepared
from .progress import Progress
from .ssp.writer.writing import Experiment, write_ssp
from .system.model import System


def export(
    name: str,
    description: str,
    system: System,
    options: Options,
    file: Path,
    nested: bool,
    progress: Progress,
) -> None:
    """Write a system, with all that the options change, and its FMUs to `file`.

    `nested` makes one system per branch. Raises CommandError for what does not fit, RunError where
    something cannot be built or written.
    """
    times = run_times(options, name)
    system, fmus = prepared(system, options, progress)
    experiment = Experiment(times.start, times.stop, times.step)
    write_ssp(file, name, description, system, fmus, experiment, nested)
    progress.advance(1)
