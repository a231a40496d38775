"""Find out which components compute at communication points only, from what their FMUs declare."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass

from ...fmu.file import FmuFile

_OUR_TOOL = "fmublock"
"""End of the name of the tool that builds our FMUs. Their discrete states are discrete local variables."""


@dataclass(frozen=True)
class Sampling:
    """Which components sample, by name.

    Attributes:
        samplers: Components that compute at communication points, such as digital controllers.
        unknown: Components that do not show whether they do.
    """

    samplers: frozenset[str]
    unknown: frozenset[str]


def find_sampling(files: Mapping[str, FmuFile], declared: Collection[str]) -> Sampling:
    """Return which components sample.

    Args:
        files: The FMU of each component.
        declared: Components that are declared to sample.
    """
    samples_by_name = {name: True if name in declared else _is_sampling(file) for name, file in files.items()}
    samplers, unknown = (
        frozenset(n for n, s in samples_by_name.items() if s is kind) for kind in (True, None)
    )
    return Sampling(samplers, unknown)


def _is_sampling(file: FmuFile) -> bool | None:
    """Return whether an FMU samples; None if its description does not show it."""
    description, is_ours = file.description, str(file.description.generationTool).endswith(_OUR_TOOL)
    causalities = ("local",) if is_ours else ("local", "output", "independent")
    variables = [v for v in file.variables.values() if v.causality in causalities]
    if file.interface.clocks or any(v.variability == "discrete" for v in variables):
        return True
    return False if is_ours or description.derivatives else None
