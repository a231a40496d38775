"""A comparison laid out: every run, and the prepared simulations that it takes."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ..base.errors import CommandError
from ..base.progress import Progress
from ..run.experiment import check_run, run_times
from ..study.loading import load
from ..study.roles import joints
from ..sweeps.farm import Work
from ..sweeps.shipment import Preparation
from ..sweeps.targets import as_arguments, changed_in_run, merged
from ..sweeps.worker import Variant
from .cases import Case, left_out
from .entrants import Entrant
from .parts import parts
from .reserves import CURRENT, VOLTAGE, Reserves, reserve_values, stated
from .seeds import HeldOut, random_seeds


@dataclass(frozen=True)
class Heat:
    """One run: a controller, under one circumstance, in a part of a scenario that has these joints.

    `own` has the options that are the circumstance; `group` is the position of the prepared simulation.
    `seed` is the held-out seed of its random sequences, None where they are those of the scenario.
    """

    scenario: str
    entrant: Entrant
    case: Case
    joints: Sequence[str]
    own: Mapping[str, Any]
    group: int
    seed: int | None = None


@dataclass(frozen=True)
class Contest:
    """All heats, in the order of the tables.

    `options` are those of all runs, `notes` what a reader has to know: what is left out, and the reserves
    of each controller.
    """

    heats: Sequence[Heat]
    groups: Sequence[Preparation]
    options: Mapping[str, Any]
    notes: Sequence[str]

    def variant(self, number: int) -> Variant:
        """A heat as it is run."""
        return Variant(number, changed_in_run(self.heats[number].own))

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


@dataclass(frozen=True)
class Terms:
    """On what terms controllers meet.

    `seeds` is the number of held-out seeds for runs in which anything is random, 0 for the seeds of the
    scenario; `reserves` are those of all controllers, None for each one's own. `options` are for all runs.
    """

    seeds: int
    reserves: Reserves | None
    options: Mapping[str, Any]


def laid_out(
    scenarios: Sequence[str],
    entrants: Sequence[Entrant],
    cases: Sequence[Case],
    terms: Terms,
    progress: Progress,
) -> Contest:
    """Build what is missing, and lay out all heats.

    Raises CommandError for whatever is wrong with scenarios and options, and for a scenario without joints;
    RunError where FMUs cannot be built.
    """
    heats, groups = list[Heat](), list[Preparation]()
    run = set[tuple[str, str]]()
    held_out = HeldOut(terms.seeds)
    kept, fixed = dict[str, dict[str, None]](), dict[str, None]()
    for scenario in scenarios:
        for entrant in entrants:
            for part, case, own in _cases(scenario, entrant, cases, terms, progress):
                if not groups or groups[-1] is not part:
                    groups.append(part)
                run.add((scenario, case.name))
                kept.setdefault(str(entrant), {})[stated(part, own["set"])] = None
                if terms.reserves is not None and not reserve_values(part, terms.reserves):
                    fixed[str(entrant)] = None
                for seed, options in _seeded(part, own, held_out, terms.options):
                    heats.append(Heat(scenario, entrant, case, _joints(part), options, len(groups) - 1, seed))
    notes = [
        left_out(missing, scenario)
        for scenario in scenarios
        if (missing := [case for case in cases if (scenario, case.name) not in run])
    ]
    if not heats:
        raise CommandError(" ".join(notes))
    known = [f"Note: {note}." for group in groups if group.scenario for note in group.scenario.notes]
    notes += dict.fromkeys(known)
    reserves = "; ".join(f"{name} {', '.join(found)}" for name, found in kept.items())
    notes.append(f"Reserves of current and voltage: {reserves}.")
    notes += [f"{name} keeps its own reserves: it has no {CURRENT} and {VOLTAGE} to set." for name in fixed]
    return Contest(heats, groups, terms.options, notes)


def _seeded(
    part: Preparation, own: Mapping[str, Any], held_out: HeldOut, options: Mapping[str, Any]
) -> Iterator[tuple[int | None, Mapping[str, Any]]]:
    """Held-out seeds with the options that they make of a run; one None where nothing is random."""
    names = random_seeds(part, own["set"], options.get("set") or {}) if held_out.drawn else []
    if not names:
        yield None, own
    else:
        for seed in held_out.drawn:
            yield seed, merged([own, {"set": held_out.values(names, seed)}])


def _cases(
    scenario: str,
    entrant: Entrant,
    cases: Sequence[Case],
    terms: Terms,
    progress: Progress,
) -> Iterator[tuple[Preparation, Case, Mapping[str, Any]]]:
    """Parts of a scenario with the cases that they can run, and the options that these are."""
    options = terms.options
    usual = _parts(scenario, entrant, options, progress)
    for part in usual:
        for case in cases:
            if not case.fault and (values := case.applied(part)) is not None:
                yield part, case, {"set": _on_terms(values, part, terms)}
    joints = [joint for part in usual for joint in _joints(part)]
    for case in cases:
        if case.fault:  # which is put into the system before it is prepared
            own = {"fault": [*options.get("fault", ()), *case.faults(joints)]}
            for part in _parts(scenario, entrant, {**options, **own}, progress):
                if (values := case.applied(part)) is not None:
                    yield part, case, {**own, "set": _on_terms(values, part, terms)}


def _on_terms(values: Mapping[str, Any], part: Preparation, terms: Terms) -> dict[str, Any]:
    return {**values, **({} if terms.reserves is None else reserve_values(part, terms.reserves))}


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
