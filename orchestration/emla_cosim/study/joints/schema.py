"""Joint files: all data of a joint. Those that come with the study are read by name."""

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import msgspec

from emla_fmu.observer_gains import ObserverGains
from emla_fmu.parameters import EmlaParameters

from ...base.errors import CommandError, join_names
from ...base.toml_structs import list_given, read_toml
from ...base.values import convert_value
from ..actuator.actuator import Actuator
from ..packaged_files import list_joint_names as list_joint_names
from ..packaged_files import read_joint_text
from .joint_table import Cells, GainSet, GainTable, JointTable, ObserverSet, joint_struct
from .motions import Compliance, JointExperiment

KIND = "joint"
"""The value of `kind` in a joint file."""


class JointFile(JointTable, frozen=True, kw_only=True):
    """All data of a joint: its actuator, motion and load, and the gains of its controllers.

    Attributes:
        run: The options of its scenario.
        disturbance: Parameters by attribute of the block.
        plant: Parameters by attribute of the block.
        realistic: The actuator with the entries of `[drive]`.
        experiments: Motion and load by scenario.
        printed: Figures of the paper by scenario and controller.
    """

    name: str
    label: str
    run: Mapping[str, Any]
    actuator: Actuator
    realistic: Actuator
    disturbance: Mapping[str, Any]
    plant: Mapping[str, Any]
    observers: Mapping[str, ObserverSet]
    gains: Mapping[str, Mapping[str, GainSet]]

    @property
    def emla(self) -> EmlaParameters:
        """The parameters of the joint's actuator."""
        return self.actuator.emla

    @property
    def sheet(self) -> Actuator:
        """The actuator with which the joint runs in a scenario of its own."""
        return self.realistic if self.drive.always else self.actuator

    @property
    def compliant_load(self) -> Compliance:
        """The load that is not rigid; raise CommandError if the file lacks it."""
        if self.compliance is None:
            raise CommandError(f"{self.label} lacks the table [compliance].", joint=self.name)
        return self.compliance

    def gain_set(self, controller: str, name: str) -> GainSet:
        """Return a set of gains; raise CommandError if the file lacks it for the controller."""
        sets = self.gains.get(controller, {})
        if name not in sets:
            alternatives = f", or choose {join_names(sets)} with --gains" if sets else ""
            raise CommandError(
                f"{self.label} has no gains '{name}' for the controller '{controller}'; "
                f"add [gains.{controller}.{name}]{alternatives}.",
                joint=self.name,
                controller=controller,
                gains=name,
            )
        return sets[name]

    def experiment(self, scenario: str) -> JointExperiment:
        """Return motion and load of a scenario; raise CommandError if the file lacks them."""
        if scenario not in self.experiments:
            raise CommandError(f"{self.label} lacks the table [experiment.{scenario}].")
        return self.experiments[scenario]

    def printed_in(self, scenario: str) -> Mapping[str, Cells]:
        """Return the paper's figures for a scenario, by controller; raise CommandError if there are none."""
        if scenario not in self.printed:
            raise CommandError(f"{self.label} lacks the table [paper.{scenario}], the figures of the paper.")
        return self.printed[scenario]

    def observer_of(
        self, gains: Mapping[str, ObserverGains] | str, controller: str, gain_set: str
    ) -> ObserverSet:
        """Return the observer of a set of gains that is not in the file.

        Args:
            gains: Gains of the observer by joint, or the name of a set of the file.
            controller: The name of the controller in messages.
            gain_set: The name of the set in messages.

        Raises:
            CommandError: There are none for this joint.
        """
        if isinstance(gains, str):
            if gains in self.observers:
                return self.observers[gains]
            missing = f"add [observer.{gains}]"
            if self.observers:
                missing = f"{missing}, or choose {join_names(self.observers)} with --gains"
        elif self.name in gains:
            return ObserverSet(gains[self.name])
        else:
            missing = "add them to the observer of its ec.Gains"
        raise CommandError(
            f"{self.label} lacks observer gains for '{gain_set}' of the controller '{controller}'; "
            f"{missing}.",
            joint=self.name,
            controller=controller,
            gains=gain_set,
        )


def has_tuning(name: str) -> bool:
    """Return whether a joint file has the table `[tuning]`; False for a file that is not TOML."""
    text = read_joint_text(name)
    try:
        # asked of all joints when plans are listed
        return "tuning" in text and "tuning" in read_toml(text, name)  # reading takes longer
    except CommandError:
        return False


@cache
def load_joint(name: str) -> JointFile:
    """Return a joint by name; raise CommandError for an unknown name or an error in the file."""
    label = f"the joint '{name}'"
    return parse_joint(read_toml(read_joint_text(name), label), label, name, Path())


def parse_joint(content: Mapping[str, Any], label: str, name: str, folder: Path) -> JointFile:
    """Return the joint of a joint file's content; paths in it are relative to `folder`.

    Raises:
        CommandError: An entry is unknown, missing or wrong.
    """
    if not name.isidentifier():
        raise CommandError(
            f"{label} cannot name a joint: '{name}' is invalid; use letters, digits and _ in the "
            "file name, and begin it with a letter."
        )
    table = convert_value(content, joint_struct(), label, folder)
    observers = {key: _build_observer_set(gains) for key, gains in table.observers.items()}
    gains = {
        controller: {
            key: _build_gain_set(set_, observers, f"[gains.{controller}.{key}] of {label}")
            for key, set_ in list_given(sets).items()
        }
        for controller, sets in (list_given(table.gains) if table.gains is not None else {}).items()
    }
    entries = msgspec.structs.asdict(table.drive)
    drive = {name: entries[name] for name in entries if name != "always" and entries[name]}
    converted = {
        "run": _complete_run_options(list_given(table.run), name),
        "realistic": table.actuator.changed(drive, f"[drive] of {label}") if drive else table.actuator,
        "disturbance": list_given(table.disturbance),
        "plant": list_given(table.plant),
        "observers": observers,
        "gains": gains,
    }
    return JointFile(**{**msgspec.structs.asdict(table), **converted}, name=name, label=label)


def _complete_run_options(options: dict[str, Any], joint: str) -> dict[str, Any]:
    """Return the options with the joint's name put before those of its components; changes `options`."""
    if isinstance(options.get("order"), list):
        options["order"] = [f"{joint}.{role}" for role in options["order"]]
    if isinstance(options.get("step_multiples"), Mapping):
        options["step_multiples"] = {f"{joint}.{role}": n for role, n in options["step_multiples"].items()}
    return options


def _build_observer_set(table: Any) -> ObserverSet:
    return ObserverSet(table.gains(), table.estimate)


def _build_gain_set(table: Any, observers: Mapping[str, ObserverSet], label: str) -> GainSet:
    """Return the set of gains of a table; raise CommandError if it names a missing set of the observer."""
    # most sets serve both
    machine: GainTable = table if table.on_machine is None else table.on_machine
    if not isinstance(table.observer, str):
        return GainSet(table.gains(), _build_observer_set(table.observer), machine.gains())
    if table.observer not in observers:
        names = f"it must be {join_names(observers)}" if observers else f"add [observer.{table.observer}]"
        raise CommandError(f"'observer' in {label} is '{table.observer}', which is missing; {names}.")
    return GainSet(table.gains(), observers[table.observer], machine.gains())
