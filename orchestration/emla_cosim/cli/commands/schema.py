"""`emla schema`."""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import msgspec
from rich.table import Table

from fmu_verify.references.reference_files import ReferenceTable

from ...analyses.frame.plan_files import plan_struct
from ...analyses.identify.plan import IdentificationPlan
from ...analyses.sweep.plan import Plan
from ...analyses.tune.plan import TuningPlan
from ...base.errors import check_choice
from ...base.option import argument
from ...base.toml_structs import make_schema
from ...run.scenarios.scenario_file import scenario_struct
from ...study.actuator.entries import ACTUATOR
from ...study.joints.joint_table import joint_struct
from ...study.machines.machine_file import machine_struct
from ...study.registration import register
from ...views.terminal import print_exactly, show

register()


class FileKind(NamedTuple):
    """A kind of file: what it is for, and its struct."""

    about: str
    struct: Callable[[], type[msgspec.Struct]]


def _import_trajectory_struct() -> type[msgspec.Struct]:
    # loads casadi and scipy, which other kinds do not need
    from ...analyses.trajectory.problem import PROBLEM

    return PROBLEM


FILE_KINDS: Mapping[str, FileKind] = {
    "scenario": FileKind("Scenario: a system and options to run it", scenario_struct),
    "joint": FileKind("Joint: actuator, gains, motion and load", joint_struct),
    "machine": FileKind("Machine: bodies, actuators, motion and options", machine_struct),
    "actuator": FileKind("Data sheet of an actuator", lambda: ACTUATOR),
    "sweep": FileKind("Plan of emla sweep", lambda: plan_struct(Plan.struct())),
    "tune": FileKind("Plan of emla tune", lambda: plan_struct(TuningPlan.struct())),
    "identify": FileKind("Plan of emla identify", lambda: plan_struct(IdentificationPlan.struct())),
    "trajectory": FileKind("Problem of emla trajectory", _import_trajectory_struct),
    "reference": FileKind("What belongs to a reference solution, MODEL_ref.toml", lambda: ReferenceTable),
}
"""Kinds of files in TOML that commands read, by name."""

EXAMPLES = ("emla schema", "emla schema joint")


@dataclass(frozen=True)
class Parameters:
    """Arguments of the command."""

    kind: str | None = argument(None, help="Kind of file. Default: list the kinds.", metavar="KIND")


def command(parameters: Parameters, options: dict[str, Any]) -> None:
    """Print the JSON Schema of a kind of file, with which editors complete and check."""
    if parameters.kind is None:
        table = Table("kind", "file", title="Kinds of files: emla schema KIND", title_justify="left")
        for name, (about, _) in FILE_KINDS.items():
            table.add_row(f"[bold]{name}[/]", about)
        show(table)
        return
    check_choice("kind of file", parameters.kind, FILE_KINDS)
    kind = FILE_KINDS[parameters.kind]
    print_exactly(json.dumps(make_schema(kind.struct(), kind.about), indent=2) + "\n")
