"""An actuator, read from a file or created in Python."""

import hashlib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass, field, is_dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from emla_fmu.drive import drive
from emla_fmu.observer_gains import ObserverGains, with_poles
from emla_fmu.parameters import EmlaParameters
from rsba_fmu.foc_gains import FocGains
from rsba_fmu.gains import RsbaGains

from ...base.errors import CommandError, join_names
from ...base.files import read_file
from ...base.option import FileOrObject
from ...base.table_entries import Location, combine_problems, unknown_entry
from ...base.toml_structs import list_given, read_toml
from ...base.values import convert_at
from . import derived
from .consistency import find_contradictions, remarks
from .conversion import Conversion, list_conversions
from .entries import ACTUATOR, ANY_OF, ONE_OF, REQUIRED_TABLES, TABLES, SheetTable, SheetValue


def read_tables(path: Path) -> tuple[dict[str, Any], str]:
    """Return the tables of an actuator's file and its SHA-256; raise CommandError if it is not TOML."""
    label, content = f"the actuator '{path}'", read_file(path, "the actuator")
    try:
        # editors on Windows write a byte order mark
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise CommandError(f"{label} is not a text in UTF-8.") from error
    return read_toml(text, label), hashlib.sha256(content).hexdigest()


@dataclass(frozen=True)
class Actuator(FileOrObject):
    """Actuator as its data sheets describe it.

    Parameters of plant, observer and controller are derived from it. Each table has quantities as on the data
    sheet, such as `motor={"R": "2.3 Ohm line to line", ...}`; docs/actuator.md lists the entries.

    Args:
        motor: entries of the motor.
        screw: entries of the screw.
        inverter: entries of the inverter.
        sensor: entries of the sensors.
        gearbox: entries of the gearbox.
        coupling: entries of the coupling.
        friction: entries of the friction.
        stop: entries of the end stops.
        thermal: entries of the winding temperature.
        compliance: entries of stiffness and backlash, for a load that is not rigid.
        control: entries of the controller.
        name: name for people.
        source: source of the data, for people.
        file: file that it was read from.
        sha256: hash of that file.

    Raises:
        CommandError: entries are missing, wrong or contradict each other; the message lists all of them.
    """

    motor: Mapping[str, Any]
    screw: Mapping[str, Any]
    inverter: Mapping[str, Any]
    sensor: Mapping[str, Any]
    gearbox: Mapping[str, Any] = field(default_factory=dict)
    coupling: Mapping[str, Any] = field(default_factory=dict)
    friction: Mapping[str, Any] = field(default_factory=dict)
    stop: Mapping[str, Any] = field(default_factory=dict)
    thermal: Mapping[str, Any] = field(default_factory=dict)
    compliance: Mapping[str, Any] = field(default_factory=dict)
    control: Mapping[str, Any] = field(default_factory=dict)
    name: str = ""
    source: str = ""
    file: Path | None = None
    sha256: str | None = None

    def __post_init__(self) -> None:
        if problems := self._list_problems() or [f"{text}." for text in find_contradictions(self.values)]:
            raise combine_problems(self.label, problems)

    @classmethod
    def read(cls, path: str | Path) -> "Actuator":
        """Read an actuator from a TOML file.

        Raises:
            CommandError: the file cannot be read, or its entries are wrong.
        """
        path = Path(path)
        tables, sha256 = read_tables(path)
        return cls.of_tables(tables, f"the actuator '{path}'", path, sha256)

    @classmethod
    def of_tables(
        cls, tables: Mapping[str, Any], label: str, file: Path | None = None, sha256: str | None = None
    ) -> "Actuator":
        """Return the actuator of the tables of a file.

        Args:
            tables: The content of the file.
            label: The name of the actuator in messages.
            file: The path of the file.
            sha256: The hash of the file.

        Raises:
            CommandError: Entries are wrong; the message lists all faults.
        """
        # first, as a wrong name makes the right one missing
        names = ACTUATOR.__struct_fields__
        if problems := [str(unknown_entry("it", key, names)) for key in tables if key not in names]:
            raise combine_problems(label, problems)
        try:
            return cls(**{**{name: {} for name in REQUIRED_TABLES}, **tables}, file=file, sha256=sha256)
        except CommandError as error:
            raise combine_problems(label, error.fields["problems"]) from None

    def changed(self, entries: Mapping[str, Mapping[str, Any]], label: str) -> "Actuator":
        """Return the actuator with other entries.

        Args:
            entries: Values by table and entry.
            label: The name of the new actuator in messages.

        Raises:
            CommandError: Entries are wrong; the message lists all faults.
        """
        tables: dict[str, Any] = {
            name: {**content, **entries.get(name, {})} for name, content in self.tables.items()
        }
        texts = {"name": self.name, "source": self.source}
        return Actuator.of_tables({**tables, **texts}, label, self.file, self.sha256)

    @property
    def tables(self) -> dict[str, Mapping[str, Any]]:
        """The tables by name."""
        return {name: getattr(self, name) for name in TABLES}

    def _list_problems(self) -> list[str]:
        """Return a message for each entry that is missing, unknown or invalid."""
        problems = list[str]()
        try:
            poles = self.printed.get("motor.poles")
        except CommandError as error:
            problems, poles = [*error.fields.get("problems", [str(error)])], None
        if poles is not None and poles.number % 2.0:
            problems.append(f"motor.poles is {poles.text}; it must be even.")
        if all(isinstance(content, Mapping) for content in self.tables.values()):
            problems += _describe_wrong_combinations(self.tables)
        return problems

    @property
    def label(self) -> str:
        """The name of the actuator in messages."""
        if self.file is not None:
            return f"the actuator '{self.file}'"
        return f"the actuator '{self.title}'" if self.title else "the actuator"

    @property
    def title(self) -> str:
        """The name of the actuator, on one line."""
        return " ".join("".join(c if c.isprintable() else " " for c in self.name).split())

    @cached_property
    def printed(self) -> dict[str, SheetValue]:
        """All entries by "table.key"."""
        tables = {
            name: content for name, content in self.tables.items() if name in REQUIRED_TABLES or content != {}
        }
        content = {"name": self.name, "source": self.source, **tables}
        sheet = convert_at(content, ACTUATOR, Location("", ""))
        return {
            f"{table}.{key}": value
            for table, entries in list_given(sheet, SheetTable.__struct_fields__).items()
            for key, value in list_given(entries).items()
        }

    @property
    def values(self) -> dict[str, float]:
        """The entered values in SI units, as peak values of a phase."""
        return {name: entry.number for name, entry in self.printed.items()}

    @cached_property
    def emla(self) -> EmlaParameters:
        """The parameters that plant, observer and controller share."""
        return derived.emla(self.values)

    @cached_property
    def plant(self) -> dict[str, Any]:
        """The other parameters of the plant, by attribute of the block."""
        return derived.plant(self.values)

    @property
    def i_N(self) -> float:
        """Continuous stall current in A (peak); 0 if the data sheet does not state it."""
        return self.values.get("motor.i_N", 0.0)

    def braking(self, load: float) -> float:
        """Return a_max in m/s2 with a load force in N."""
        return derived.braking(self.values, load)

    @property
    def remarks(self) -> list[str]:
        """Warnings on values that are possible but probably not meant, without full stops."""
        return [*remarks(self.values)]

    @property
    def conversions(self) -> list[Conversion]:
        """The entries, each with the parameter that follows from it."""
        return [*list_conversions(self.printed)]

    def record(self) -> dict[str, Any]:
        """Return the content for run.json."""
        return {
            "file": None if self.file is None else str(self.file),
            "sha256": self.sha256,
            "name": self.name,
            "source": self.source,
            "entered": {name: entry.text for name, entry in self.printed.items()},
            "conversion": [str(conversion) for conversion in self.conversions],
        }


def _describe_wrong_combinations(tables: Mapping[str, Mapping[str, Any]]) -> Iterator[str]:
    """Yield a message for each choice between entries that a sheet leaves open, or makes twice."""
    for table, keys in (*ONE_OF, *ANY_OF):
        existing = [key for key in keys if key in tables[table]]
        if not existing:
            examples = {entry.key: entry.example for entry in TABLES[table]}
            texts = [f'{key} = "{examples[key]}"' for key in keys]
            yield f"[{table}] lacks {' or '.join(keys)}; write {' or '.join(texts)}."
        if len(existing) > 1 and (table, keys) in ONE_OF:
            yield f"[{table}] has {join_names(existing)}, which mean the same; keep one."
    has_L, has_L_d, has_L_q = (key in tables["motor"] for key in ("L", "L_d", "L_q"))
    if has_L_d != has_L_q or has_L == has_L_d:
        yield "[motor] needs L, or both L_d and L_q."
    if tables["thermal"] and "i_N" not in tables["motor"]:
        yield "[thermal] needs motor.i_N, the current that causes its permitted_rise."


Actuators = Mapping[str, Actuator]
"""Actuators by joint, which replace the joint's own."""

NONE: Actuators = {}


def check_actuator_joints(actuators: Actuators, joints: Iterable[str]) -> None:
    """Raise CommandError if a joint with an actuator does not exist."""
    names = list(joints)
    for name in actuators:
        if name not in names:
            raise CommandError(
                f"there is no joint '{name}' for an actuator; use {join_names(names)}.", name=name
            )


def realistic_plant_values(actuator: Actuator) -> dict[str, Any]:
    """Return the parameters of a realistic drive: entries, and the rest by the rule for all drives."""
    return asdict(drive(actuator.emla, actuator.i_N)) | actuator.plant


def controller_gains(gains: Any, actuator: Actuator | None, load: float, sample_time: float) -> Any:
    """Return the gains of a joint's controller for an actuator.

    a_max is what the motor can brake. Unless the actuator sets their rates, position and speed loop keep
    theirs.

    Args:
        gains: Gains of the controller.
        actuator: The actuator; None leaves the gains unchanged.
        load: Load force in N.
        sample_time: Sample time in s; the actuator's entries are parts of 1 / `sample_time`.
    """
    if actuator is None or not is_dataclass(gains) or isinstance(gains, type):
        return gains
    changes: dict[str, Any] = {"a_max": actuator.braking(load)}
    entered = {name: actuator.values.get(f"control.{name}") for name in _LOOPS}
    rates = {name: k / sample_time for name, k in entered.items() if k is not None}
    if isinstance(gains, RsbaGains):
        # the loops of the currents depend on the sample time alone
        beta_1, beta_2, *currents = gains.beta
        k_1, k_2 = rates.get("k_1", 0.5 * beta_1), rates.get("k_2", 0.5 * beta_2)
        changes["beta"] = (2.0 * k_1, 2.0 * k_2, *currents)
    if isinstance(gains, FocGains):
        changes |= {name: rates[k] for k, name in zip(_LOOPS, ("k_p", "k_v"), strict=True) if k in rates}
    return replace(gains, **changes)


_LOOPS = ("k_1", "k_2")


def observer_gains(gains: ObserverGains, actuator: Actuator | None, sample_time: float) -> ObserverGains:
    """Return the gains of a joint's observer for an actuator."""
    if actuator is None or "control.observer" not in actuator.values:
        return gains
    return with_poles(gains, actuator.values["control.observer"] / sample_time)
