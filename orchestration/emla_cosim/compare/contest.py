"""A comparison laid out: every run, and the prepared simulations that it takes."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ..errors import CommandError
from ..experiment import check_run, run_times
from ..loading import load
from ..progress import Progress
from ..simulation import PREPARED
from ..study.roles import joints
from ..sweep.farm import Work
from ..sweep.shipment import Preparation
from ..sweep.targets import as_arguments, merged
from ..sweep.worker import Variant
from .cases import Case, left_out
from .entrants import Entrant
from .parts import parts


@dataclass(frozen=True)
class Heat:
    """One run: a controller, under one circumstance, in a part of a scenario that has these joints.

    `own` has the options that are the circumstance; `group` is the position of the prepared simulation.
    """

    scenario: str
    entrant: Entrant
    case: Case
    joints: Sequence[str]
    own: Mapping[str, Any]
    group: int


@dataclass(frozen=True)
class Contest:
    """All heats, in the order of the tables. `options` are those of all runs, `notes` what is left out."""

    heats: Sequence[Heat]
    groups: Sequence[Preparation]
    options: Mapping[str, Any]
    notes: Sequence[str]

    def variant(self, number: int) -> Variant:
        """A heat as it is run."""
        return Variant(number, {n: x for n, x in self.heats[number].own.items() if n not in PREPARED})

    def work(self) -> list[Work]:
        """All heats by group, those with the most steps first, so that workers end at about the same time."""
        numbers: list[list[int]] = [[] for _ in self.groups]
        for number, heat in enumerate(self.heats):
            numbers[heat.group].append(number)
        steps = [run_times(group.options, group.name).steps for group in self.groups]
        order = sorted(range(len(self.groups)), key=lambda group: -steps[group])
        return [Work(group, numbers[group]) for group in order if numbers[group]]

    def command(self, number: int) -> list[str] | None:
        """The command that runs a heat alone; None where an option is an object of Python."""
        heat = self.heats[number]
        own = {"controller": heat.entrant.controller, "gains": heat.entrant.gains}
        arguments = as_arguments(merged([self.options, own, heat.own]))
        return None if arguments is None else ["emla", "run", heat.scenario, *arguments]


def laid_out(
    scenarios: Sequence[str],
    entrants: Sequence[Entrant],
    cases: Sequence[Case],
    options: Mapping[str, Any],
    progress: Progress,
) -> Contest:
    """Build what is missing, and lay out all heats.

    Raises CommandError for whatever is wrong with scenarios and options, and for a scenario without joints;
    RunError where FMUs cannot be built.
    """
    heats, groups = list[Heat](), list[Preparation]()
    run = set[tuple[str, str]]()
    for scenario in scenarios:
        for entrant in entrants:
            for part, case, own in _cases(scenario, entrant, cases, options, progress):
                if not groups or groups[-1] is not part:
                    groups.append(part)
                run.add((scenario, case.name))
                heats.append(Heat(scenario, entrant, case, _joints(part), own, len(groups) - 1))
    notes = [
        left_out(missing, scenario)
        for scenario in scenarios
        if (missing := [case for case in cases if (scenario, case.name) not in run])
    ]
    if not heats:
        raise CommandError(" ".join(notes))
    known = [f"Note: {note}." for group in groups if group.scenario for note in group.scenario.notes]
    notes += dict.fromkeys(known)
    return Contest(heats, groups, options, notes)


def _cases(
    scenario: str,
    entrant: Entrant,
    cases: Sequence[Case],
    options: Mapping[str, Any],
    progress: Progress,
) -> Iterator[tuple[Preparation, Case, Mapping[str, Any]]]:
    """Parts of a scenario with the cases that they can run, and the options that these are."""
    usual = _parts(scenario, entrant, options, progress)
    for part in usual:
        for case in cases:
            if not case.fault and (values := case.applied(part)) is not None:
                yield part, case, {"set": values}
    joints = [joint for part in usual for joint in _joints(part)]
    for case in cases:
        if case.fault:  # which is put into the system before it is prepared
            own = {"fault": [*options.get("fault", ()), *case.faults(joints)]}
            for part in _parts(scenario, entrant, {**options, **own}, progress):
                if (values := case.applied(part)) is not None:
                    yield part, case, {**own, "set": values}


def _parts(
    scenario: str, entrant: Entrant, options: Mapping[str, Any], progress: Progress
) -> list[Preparation]:
    """The parts of a scenario that have joints, closed by this controller."""
    chosen = load(scenario, **{**options, "controller": entrant.controller, "gains": entrant.gains})
    check_run(chosen.options, chosen.name)
    found = [part for part in parts(Preparation.of(chosen, progress)) if _joints(part)]
    if not found:
        raise CommandError(
            f"'{scenario}' has no joint, a plant with its reference, to compare controllers on."
        )
    return found


def _joints(part: Preparation) -> list[str]:
    return joints([c.name for c in part.system.components])
