"""Arguments and options that several commands declare: fields of their `Parameters`."""

from functools import partial

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
