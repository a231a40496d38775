"""Arguments and options that several commands declare: fields of their `Parameters`."""

from collections.abc import Sequence
from functools import partial

from ...base.errors import CommandError
from ...base.option import OUTPUT, RUNS, argument, option, switch

SOURCE = (
    "Scenario: a name from `emla list`, a scenario file (.toml), an SSP (.ssp, .ssd, or a folder), an "
    "FMU (.fmu), or a run.json."
)
"""Help of the argument that names a scenario."""

scenario = partial(argument, help=SOURCE, metavar="SCENARIO")

plan = partial(
    argument,
    help="Plan: a file (.toml) or a name from `emla list`; or a scenario as for `emla run`.",
    metavar="PLAN",
)

scheduler = partial(
    option,
    help="Scheduler of a Dask cluster, such as tcp://10.0.0.1:8786. Default: the cores of this machine.",
    metavar="ADDRESS",
    group=RUNS,
)

workers = partial(option, help="Number of processes on this machine. Default: one per core.", group=RUNS)

report = partial(switch, "Write a page with all results into the output folder.", OUTPUT)


def read_factors(texts: Sequence[str]) -> dict[str, str]:
    """Return the factors with their values. Raise CommandError for texts that are none."""
    from ...analyses.variants.distributions import FORMS  # slow to import

    factors = dict[str, str]()
    for text in texts:
        name, equals, values = (part.strip() for part in text.partition("="))
        if not (name and equals and values):
            raise CommandError(f"--vary {text} has no name or no values; write --vary NAME={FORMS}.")
        if name in factors:
            raise CommandError(f"--vary names {name} twice.")
        factors[name] = values
    return factors
