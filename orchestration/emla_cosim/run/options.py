"""All options of a run. The command line, scenario files, run.json and the identity of a checkpoint use them.

Algorithms, step-size controls and recorders add options of their own: the fields of their classes.
"""

import dataclasses
import difflib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from ..base.errors import CommandError, join_names
from ..base.option import FileOrObject, Option, options_of
from ..base.quantities import read_quantity
from ..base.values import convert_value, list_elements
from ..master.algorithms.algorithm import Algorithm
from ..master.algorithms.registry import ALGORITHMS
from ..master.stepping.step_size_control import STEP_SIZE_CONTROLS, StepSizeControl
from ..recorders.recorder import Recorder
from ..recorders.registry import RECORDERS, table_names
from ..system.bond import Bond
from ..system.model import Replacement
from .choices import CHOICES, Resolution, list_option_names, merge_value, resolve
from .output_options import AnalysisOptions, OutputOptions
from .stepping_options import SteppingOptions
from .stored_margins import RECORD
from .system_options import SystemOptions

_Kind = TypeVar("_Kind")


@dataclass(frozen=True)
class Options(AnalysisOptions, OutputOptions, SteppingOptions, SystemOptions):
    """Values of all options of a run. Times are in s.

    None means the value of the scenario, or the default.

    Attributes:
        resolution: Choices of classes, and options of these classes.
    """

    resolution: Resolution = dataclasses.field(default_factory=lambda: resolve(()))

    def updated(self, overrides: Mapping[str, Any]) -> "Options":
        """Return the options with other values.

        Args:
            overrides: values by name, as `load` takes them.

        Raises:
            CommandError: a name does not exist, or a value has a wrong type or range.

        Examples:
            >>> import emla_cosim as ec
            >>> ec.Options().updated({"stop_time": "10 ms"}).stop_time
            0.01
        """
        return self.merged(read_options(overrides))

    def merged(self, values: Mapping[str, Any]) -> "Options":
        """Return the options with values from `read_options`, which override earlier ones as in `resolve`."""
        if not values:
            return self
        of_classes = {n: v for n, v in values.items() if n not in _FIXED or n in CHOICES}
        resolution = resolve((*self.resolution.layers, of_classes)) if of_classes else self.resolution
        fixed = {n: merge_value(getattr(self, n), v) for n, v in values.items() if n in _FIXED}
        if "bonds" in fixed:  # a name without signals requests bonds; it does not replace them
            fixed["bonds"] = {
                **fixed["bonds"],
                **{n: text for n, text in self.bonds.items() if not values["bonds"].get(n)},
            }
        choices = {n: v for n, v in resolution.values.items() if n in CHOICES}
        return dataclasses.replace(self, **(fixed | choices), resolution=resolution)

    @property
    def class_options(self) -> Mapping[str, Any]:
        """Values of the options of algorithm, step-size control and recorders that are set, by name."""
        return {n: v for n, v in self.resolution.values.items() if n not in CHOICES}

    def overridden_notes(self) -> list[str]:
        """Return a note on each option that a later choice made useless, without full stops."""
        names = {"algorithm": self.algorithm_name, "step_size_control": self.step_size_control_name}
        nouns = {name: option.noun for name, option in list_options().items()}
        return [
            f"the {nouns[name]} of the scenario is not used: the {nouns[choice]} {names[choice]} has none"
            for name, choice in self.resolution.unused.items()
        ]

    @property
    def algorithm_name(self) -> str:
        """Name of the algorithm; the class name of an algorithm of your own."""
        return _name_of(self.algorithm, ALGORITHMS)

    @property
    def step_size_control_name(self) -> str:
        """Return the name of the step-size control in effect, or the class name of the user's own."""
        if self.step_size_control is not None:
            return _name_of(self.step_size_control, STEP_SIZE_CONTROLS)
        option_names = self.class_options.keys()
        implied = (
            n
            for n, kind in STEP_SIZE_CONTROLS.items()
            if not list_option_names(kind).isdisjoint(option_names)
        )
        return next(implied, next(iter(STEP_SIZE_CONTROLS)))  # fixed steps are the first

    def replacements(self) -> dict[str, Replacement]:
        """Return the replacements by component, with the files of the option `mapping`.

        Raises:
            CommandError: a mapping belongs to a component that is not replaced.
        """
        replacements = dict(self.replace)
        for name, file in self.mapping.items():
            if name not in replacements:
                raise CommandError(f"--mapping {name}={file} needs --replace {name}=FILE.fmu.")
            replacements[name] = dataclasses.replace(replacements[name], mapping=file)
        return replacements

    def files_read(self) -> dict[Path, str]:
        """Return the files that a run reads: what each one is, by path."""
        paths = dict.fromkeys(self.parameters, "the parameter set")
        for replacement in self.replacements().values():
            paths[replacement.fmu] = "the FMU"
            if replacement.mapping is not None:
                paths[replacement.mapping] = "the mapping"
        if self.trajectory is not None:
            paths[self.trajectory] = "the trajectory"
        paths |= {source.file: "the input" for source in self.input if source.file is not None}
        for actuator in self.actuator.values():
            if (file := actuator.file if isinstance(actuator, FileOrObject) else actuator) is not None:
                paths[file] = "the actuator"
        if isinstance(self.controller, str) and self.controller.lower().endswith(".fmu"):
            paths[Path(self.controller)] = "the FMU"
        if self.reference is not None:
            for table in (self.reference, *(self.reference / name for name in table_names())):
                paths[table] = "the run to compare with"
        if self.margins is not None:
            paths |= dict.fromkeys((self.margins, self.margins / RECORD), "the margins")
        return paths

    def read_bonds(self) -> dict[str, Bond]:
        """Return the power bonds that have signals, by name. Raise CommandError for any other text."""
        return {name: Bond.read(name, text) for name, text in self.bonds.items() if text}

    def make_algorithm(self) -> Algorithm:
        """Return the algorithm with its options.

        Raises:
            CommandError: the algorithm does not have one of the options.
        """
        return self._instantiate(self.algorithm, ALGORITHMS, "algorithm")

    def make_step_size_control(self) -> StepSizeControl:
        """Return the step-size control with its options. Raise CommandError for options it does not have."""
        control_class = self.step_size_control or self.step_size_control_name
        control = self._instantiate(control_class, STEP_SIZE_CONTROLS, "step-size control")
        control.check()
        return control

    def _instantiate(self, choice: str | _Kind, kinds: Mapping[str, type[_Kind]], noun: str) -> _Kind:
        """Return an object of the chosen class with its options, or the chosen object itself.

        Raises:
            CommandError: one of the options does not belong to the choice.
        """
        options = {n: v for n, v in self.class_options.items() if n in list_option_names(*kinds.values())}
        if not isinstance(choice, str):
            if options:
                raise CommandError(
                    f"the {noun} is an object with its own options; leave out {join_names(options)}."
                )
            return choice
        for name in options:
            if name not in list_option_names(kinds[choice]):
                owners = [n for n, kind in kinds.items() if name in list_option_names(kind)]
                has = "has" if len(owners) == 1 else "have"
                raise CommandError(
                    f"the {noun} {choice} has no {list_options()[name].noun}; {join_names(owners)} {has}.",
                    option=name,
                )
        return kinds[choice](**options)

    def make_recorders(self) -> list[Recorder]:
        """Return the recorders of `RECORDERS` whose options are set."""
        options = self.class_options
        names = (
            (kind, {n: v for n, v in options.items() if n in list_option_names(kind)})
            for kind in RECORDERS.values()
        )
        return [kind(**values) for kind, values in names if values]

    def list_effective_values(self) -> list[tuple[Option, Any]]:
        """Return each option that applies, with its value.

        Options of other step-size controls follow, with None.
        """
        pairs = [(o, getattr(self, o.name)) for o in _FIXED.values()]
        for part in (self.make_algorithm(), self.make_step_size_control(), *self.make_recorders()):
            pairs += [(o, getattr(part, o.name)) for o in options_of(type(part))]
        effective = {o.name for o, _ in pairs}
        control_options = {o.name: o for kind in STEP_SIZE_CONTROLS.values() for o in options_of(kind)}
        return pairs + [(o, None) for name, o in control_options.items() if name not in effective]


_FIXED = {o.name: o for o in options_of(Options)}


def list_options(command: str | None = None) -> dict[str, Option]:
    """Return all options by name, or those of one command. Registered classes add theirs."""
    kinds = (*ALGORITHMS.values(), *STEP_SIZE_CONTROLS.values(), *RECORDERS.values())
    options = _FIXED | {o.name: o for kind in kinds for o in options_of(kind)}
    return {n: o for n, o in options.items() if command is None or command in o.commands}


def select_repeatable(options: Mapping[str, Any]) -> dict[str, Any]:
    """Return options by name, without those that hold for one command only."""
    all_options = list_options()
    return {n: v for n, v in options.items() if n not in all_options or all_options[n].repeated}


def _name_of(choice: str | _Kind, kinds: Mapping[str, type[_Kind]]) -> str:
    if isinstance(choice, str):
        return choice
    return next((n for n, k in kinds.items() if k is type(choice)), type(choice).__name__)


def read_options(values: Mapping[str, Any], where: str = "", folder: Path | None = None) -> dict[str, Any]:
    """Read values of options by name and convert them to their types.

    Args:
        values: Values by name of the option.
        where: Source of the values, for error messages.
        folder: Folder to which paths in the values are relative.

    Raises:
        CommandError: If a name is unknown, or a value has a wrong type or range.
    """
    # one list for all values: collecting the options of all classes takes time
    allowed, of = list_options() if values else {}, f" of {where}" if where else ""
    return {
        name: read_option(name, value, f"'{name}'{of}" if of else f"the option '{name}'", folder, allowed)
        for name, value in values.items()
    }


def read_option(
    name: str, value: Any, label: str, folder: Path | None = None, allowed: Mapping[str, Option] | None = None
) -> Any:
    """Convert the value of an option to its type.

    Args:
        name: Name of the option.
        value: Value to read.
        label: Name of the value in error messages.
        folder: Folder to which paths in the value are relative.
        allowed: Options to choose from. Default: all.

    Raises:
        CommandError: If the name is not in `allowed`, or the value has a wrong type or range.
    """
    options = list_options() if allowed is None else allowed
    if name not in options:
        longer = [n for n in options if n.startswith(f"{name}_")]
        near = longer or difflib.get_close_matches(name, options, n=1)
        advice = f"there are {join_names(sorted(options))}."
        if near:
            advice = f"did you mean {' or '.join(map(repr, near[:3]))}?"
        raise CommandError(f"there is no option '{name}'; {advice}", option=name)
    option = options[name]
    takes, unit = option.takes, option.unit
    if option.flag_value and isinstance(value, bool):
        return [option.flag_value] if value else []
    if takes is not None and isinstance(value, takes):
        return value
    if unit and isinstance(value, str):
        value = read_quantity(value, label, unit)
    if option.arrays and isinstance(value, Mapping):
        value = list_elements(value)
    objects = {}
    if takes is not None and isinstance(value, Mapping):
        objects = {name: entry for name, entry in value.items() if isinstance(entry, takes)}
        value = {name: entry for name, entry in value.items() if name not in objects}
    converted = convert_value(value, option.plain_type, label, folder)
    if objects:
        return {**converted, **objects}
    for part in converted if isinstance(converted, list) else [converted]:
        option.check(part)
    return converted
