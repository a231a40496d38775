"""Options of what a run records, checks and shows, and of many runs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from ..base.errors import CommandError
from ..base.option import (
    BUILD,
    COMPARE,
    LEFT_OUT,
    OUTPUT,
    PLOT,
    REPAIR,
    RUN,
    RUNS,
    SAME,
    SHARING,
    SHOWING,
    SIZE,
    SWEEP,
    TRAJECTORY,
    VERIFY,
    option,
)
from ..base.tolerances import Tolerance, read_tolerances
from ..recorders.registry import TABLES
from .system_options import ALL

PLOT_FORMATS = {
    "png": "pixels, 150 per inch",
    "pdf": "vectors, for papers",
    "svg": "vectors, for web pages and drawing programs",
}
"""Descriptions by the ending of file names."""


def _read_bonds(texts: Sequence[str]) -> dict[str, str]:
    """Return signals by the name of a bond, from texts NAME='EFFORT * FLOW'; empty ones for a name alone."""
    bonds = {}
    for text in texts:
        name, _, signals = (part.strip() for part in text.partition("="))
        if not name:
            raise CommandError(f"--bond {text or repr(text)} has no name; write --bond NAME='EFFORT * FLOW'.")
        bonds[name] = signals
    return bonds


_output = partial(option, group=OUTPUT)
_single = partial(_output, commands=(RUN,), in_file=False)
_shared = partial(
    option, group=RUNS, recorded=False, commands=(SWEEP, COMPARE, SIZE), stage=SHARING, in_sweep=SAME
)
_display = partial(_output, recorded=False, stage=SHOWING, in_sweep=LEFT_OUT)


@dataclass(frozen=True)
class OutputOptions:
    """Options of what a run records, checks and shows."""

    output: Path | None = _display(help="Output folder. Default: results/SCENARIO.")
    overwrite: bool = _output(
        False,
        help="Replace files that emla did not write. Links, folders, devices and pipes are never replaced.",
        in_file=False,
        recorded=False,
        repeated=False,
        commands=(*ALL, BUILD, PLOT, TRAJECTORY, VERIFY, REPAIR),
    )
    plots: bool = _display(True, help="Draw plots into the output folder.")
    report: bool = _display(False, help="Write a page with results and plots, report.html.", commands=(RUN,))
    animate: bool = _display(
        False, help="Write an animation of the manipulator, manipulator.gif.", commands=(RUN,)
    )
    signals: Sequence[str] = _output(
        [],
        help="Signals to keep in the table, such as 'lift.plant.*' (repeatable). A name that no output has "
        "selects a local or other variable. Default: all outputs but Strings.",
        metavar="PATTERN",
        commands=(RUN,),
        in_sweep=LEFT_OUT,
    )
    output_interval: float | None = _output(
        help="Time between rows of the table. Default: 1 ms; in a run shorter than 10 ms, a hundredth of it.",
        unit="s",
        identity="output interval",
    )
    output_format: str = _output(
        "csv", help="File format of the table of results.", choices=lambda: TABLES, commands=(RUN,)
    )
    plot_format: str = _display(
        "png", help="File format of the plots.", choices=lambda: PLOT_FORMATS, commands=(RUN,)
    )
    require: Sequence[str] = _output(
        [],
        help="Fail unless this condition holds, such as 'lift.position_error_m < 2e-5' (repeatable).",
        metavar="'METRIC < VALUE'",
        commands=(RUN, SWEEP),
        in_sweep=SAME,
    )
    reference: Path | None = _single(
        help="Fail unless every signal agrees with an earlier run, or with a table of reference values such "
        "as MODEL_ref.csv. Name the run's output folder or the table.",
        metavar="FOLDER",
    )
    tolerance: Mapping[str, Tolerance] = _single(
        {},
        help="Tolerance of --reference relative to each signal's range, for all signals or for those that "
        "match PATTERN (repeatable). Default: 1e-3.",
        metavar="[PATTERN=]NUMBER",
        parse=read_tolerances,
    )
    roles: Mapping[str, str] = _output(
        {},
        help="Assign a signal to a role of a joint, such as lift.x_L=axis.position (repeatable).",
        flag="--role",
        metavar="JOINT.ROLE=SIGNAL",
        commands=(RUN, SWEEP, SIZE),
        identity="roles",
    )
    criteria: Mapping[str, float | str] = _output(
        {},
        help="Set a criterion of a joint, such as 'lift.position_window=0.5 mm'; * means all joints. See "
        "docs/metrics.md (repeatable).",
        flag="--criterion",
        metavar="JOINT.CRITERION=VALUE",
        commands=(RUN, SWEEP, COMPARE, SIZE),
        identity="criteria",
    )
    bonds: Mapping[str, str] = _output(
        {},
        help="Report the energy that the coupling creates or destroys in a power bond: one of the system, "
        "such as lift or '*', or one between two signals, such as axis='load.F * actuator.v' (repeatable).",
        flag="--bond",
        metavar="NAME[='EFFORT * FLOW']",
        parse=_read_bonds,
        commands=(RUN, SWEEP),
        identity="bonds",
    )
    margins: Path | None = _single(
        help="Keep the stability margins of this output folder of emla linearize in run.json, and show them "
        "in the report.",
        metavar="FOLDER",
        recorded=False,
    )
    checkpoint: Path | None = _single(
        help="Save the state of the run to this file, every minute and at the end, for --resume.",
        recorded=False,
        repeated=False,
        in_sweep=LEFT_OUT,
    )
    resume: Path | None = _single(
        help="Continue a run from this file, written by --checkpoint.",
        record="resumed_from",
        repeated=False,
        in_sweep=LEFT_OUT,
    )
    profile: bool = _single(
        False,
        help="Measure the time and the calls of each FMU, and the time of the master and the recorders; see "
        "docs/master.md. The results are the same.",
        recorded=False,
        in_sweep=LEFT_OUT,
    )


@dataclass(frozen=True)
class AnalysisOptions:
    """Options of commands that make many runs."""

    timeout: float | None = _shared(
        help="Longest wall time of a variant. One that takes longer is ended, with the status 'timed out'. "
        "Default: no limit.",
        unit="s",
        above=0.0,
    )
    patience: float = _shared(
        60.0, help="Wall time to wait while the cluster has no workers.", unit="s", above=0.0
    )
