"""An actuator, read from a file or created in Python."""

import difflib
import hashlib
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields
from functools import cached_property
from pathlib import Path
from typing import Any

from emla_fmu.parameters import EmlaParameters

from ...base.errors import CommandError, join_names
from ...base.files import read_file
from ...base.option import FileOrObject
from . import derived
from .consistency import find_contradictions, remarks
from .conversion import Conversion, list_conversions
from .entries import ANY_OF, NEEDED, ONE_OF, TABLES, SheetEntry
from .sheet_values import SheetValue, read_sheet_value

_TEXTS = ("name", "source")
_NOTHING: Mapping[str, Any] = {}


def actuator_tables(path: Path) -> tuple[dict[str, Any], str]:
    """Return the tables of an actuator's file and its SHA-256; raise CommandError if it is not TOML."""
    label, content = f"the actuator '{path}'", read_file(path, "the actuator")
    try:
        return tomllib.loads(content.decode("utf-8-sig")), hashlib.sha256(content).hexdigest()
    except UnicodeDecodeError as error:
        raise CommandError(f"{label} is not a text in UTF-8.") from error
    except (ValueError, RecursionError) as error:
        raise CommandError(f"{label} is not TOML: {error}.") from error


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
    control: Mapping[str, Any] = field(default_factory=dict)
    name: str = ""
    source: str = ""
    file: Path | None = None
    sha256: str | None = None

    def __post_init__(self) -> None:
        problems = [*_problems(self)]
        if not problems:
            problems = [*find_contradictions(self.values)]
        if problems:
            raise _raise_problems(self.label, problems)

    @classmethod
    def read(cls, path: str | Path) -> "Actuator":
        """Read an actuator from a TOML file.

        Raises:
            CommandError: the file cannot be read, or its entries are wrong.
        """
        path = Path(path)
        tables, sha256 = actuator_tables(path)
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
        if problems := [*_wrong_tables(tables)]:
            raise _raise_problems(label, problems)
        needed = {name: tables.get(name, _NOTHING) for name in NEEDED}
        try:
            return cls(**{**needed, **tables}, file=file, sha256=sha256)
        except CommandError as error:
            raise _raise_problems(label, error.fields["problems"]) from None

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
        return {place: read_sheet_value(value, entry, place) for place, entry, value in _entries(self)}

    @property
    def values(self) -> dict[str, float]:
        """The entered values in SI units, as peak values of a phase."""
        return {place: found.number for place, found in self.printed.items()}

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
            "entered": {place: found.text for place, found in self.printed.items()},
            "conversion": [str(one) for one in self.conversions],
        }


def _entries(actuator: Actuator) -> Iterator[tuple[str, SheetEntry, Any]]:
    """Yield place, entry and value of all known entries."""
    for table, entries in TABLES.items():
        given = getattr(actuator, table)
        yield from ((f"{table}.{e.key}", e, given[e.key]) for e in entries if e.key in given)


def _problems(actuator: Actuator) -> Iterator[str]:
    """Yield a message for each entry that is missing, unknown or invalid."""
    tables = {f.name: getattr(actuator, f.name) for f in fields(actuator) if f.name in TABLES}
    if wrong := [*_wrong_tables({**tables, "name": actuator.name, "source": actuator.source})]:
        yield from wrong
        return
    for table, entries in TABLES.items():
        if table in NEEDED or tables[table]:
            yield from _missing(table, tables[table], entries)
        yield from _unknown(table, tables[table], [e.key for e in entries])
    for place, entry, value in _entries(actuator):
        try:
            found = read_sheet_value(value, entry, place)
        except CommandError as error:
            yield str(error).removesuffix(".")
            continue
        if place == "motor.poles" and found.number % 2.0:
            yield f"motor.poles is {found.text}; it must be even"
    if actuator.thermal and "i_N" not in actuator.motor:
        yield "[thermal] needs motor.i_N, the current that causes its permitted_rise"


def _missing(table: str, given: Mapping[str, Any], entries: tuple[SheetEntry, ...]) -> Iterator[str]:
    """Yield a message for each entry that a table lacks."""
    examples = {e.key: e.example for e in entries}
    for entry in entries:
        if entry.needed and entry.key not in given:
            yield f'[{table}] lacks {entry.key}, the {entry.about}; write {entry.key} = "{entry.example}"'
    for where, keys in (*ONE_OF, *ANY_OF):
        if where != table:
            continue
        there = [key for key in keys if key in given]
        if not there:
            shown = [f'{key} = "{examples[key]}"' for key in keys]
            yield f"[{table}] lacks {' or '.join(keys)}; write {' or '.join(shown)}"
        if len(there) > 1 and (where, keys) in ONE_OF:
            yield f"[{table}] has {join_names(there)}, which mean the same; keep one"
    if table == "motor" and ("L" in given, "L_d" in given, "L_q" in given) not in _INDUCTANCES:
        yield "[motor] needs L, or both L_d and L_q"


_INDUCTANCES = ((True, False, False), (False, True, True))


def _unknown(table: str, given: Mapping[str, Any], known: list[str]) -> Iterator[str]:
    for key in given:
        if key not in known:
            yield f"[{table}] has the unknown entry '{key}'; {_suggest_key(key, known)}"


def _wrong_tables(content: Mapping[str, Any]) -> Iterator[str]:
    """Yield a message for each key that is not a table or text of an actuator, or has the wrong type."""
    known = [*TABLES, *_TEXTS]
    for key, value in content.items():
        if key not in known:
            yield f"it has the unknown table '{key}'; {_suggest_key(key, known)}"
        elif key in _TEXTS and not isinstance(value, str):
            yield f"'{key}' is {value!r}; it must be a text"
        elif key in TABLES and not isinstance(value, Mapping):
            yield f"'{key}' is {value!r}; it must be a table, [{key}]"


def _suggest_key(key: Any, known: list[str]) -> str:
    near = difflib.get_close_matches(str(key), known, n=1, cutoff=0.5)
    return f"did you mean '{near[0]}'?" if near else f"use {join_names(known)}"


def _raise_problems(label: str, problems: list[str]) -> CommandError:
    ended = [p if p.endswith("?") else f"{p}." for p in problems]
    if len(ended) == 1:
        return CommandError(f"{label} cannot be used: {ended[0]}", problems=problems)
    lines = "".join(f"\n  {one}" for one in ended)
    return CommandError(f"{label} cannot be used for {len(ended)} reasons:{lines}", problems=problems)
