"""One way to scenarios: built-in ones by name, scenario files, and SSPs."""

import contextlib
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from importlib.resources import files
from pathlib import Path

from ..errors import CommandError, listed
from ..ssp.reader.reading import Document, read_ssp
from ..system.model import System
from ..system.study import SYSTEMS, built_in_system
from .scenario import Scenario
from .scenario_file import ScenarioFile, parse_scenario

_FILES = files("emla_cosim.scenarios")
_SSP = (".ssp", ".ssd")
_DEFAULT_CONTROLLER = "robust"


def scenario_names() -> list[str]:
    """Names of the built-in scenarios, in the order of their systems."""
    present = {Path(f.name).stem for f in _FILES.iterdir() if f.name.endswith(".toml")}
    order = [*SYSTEMS, *sorted(present - set(SYSTEMS))]
    return [name for name in order if name in present]


@cache
def _built_in(name: str) -> ScenarioFile:
    text = _FILES.joinpath(f"{name}.toml").read_text(encoding="utf-8")
    return parse_scenario(text, name, Path())


def describe_scenario(name: str) -> str:
    """One line on a built-in scenario."""
    return _built_in(name).description


def load_scenario(name: str, controller: str | None = None) -> Scenario:
    """A built-in scenario, with other gains if `controller` names them.

    Raises CommandError for a name that does not exist.
    """
    if name not in scenario_names():
        raise CommandError(
            f"there is no scenario '{name}'; choose from {listed(scenario_names())}, or name a file that "
            "ends in .toml, .ssp or .ssd."
        )
    read = _built_in(name)
    chosen = controller or read.controller or _DEFAULT_CONTROLLER
    return _scenario(name, read, built_in_system(read.system, chosen), None)


@contextlib.contextmanager
def opened_scenario(source: str, controller: str | None = None) -> Iterator[Scenario]:
    """The scenario that a name or a path means, until the end of the block.

    A path leads to a scenario file (.toml) or to an SSP: package, folder or SSD, with `#Variant.ssd`
    for another SSD than the default one. Raises CommandError for whatever is wrong with it.
    """
    path = Path(source)
    if source in scenario_names():
        yield load_scenario(source, controller)
    elif path.suffix.lower() == ".toml":
        with _from_file(path, controller) as scenario:
            yield scenario
    elif _is_ssp(path):
        _refuse_controller(source, controller)
        with read_ssp(path) as document:
            yield _scenario(document.name, _FOR_SSP, document.system, document)
    else:
        yield load_scenario(source, controller)


_FOR_SSP = ScenarioFile("", "", None, None, None, None, None, {})


def _is_ssp(path: Path) -> bool:
    """Whether a path means an SSP."""
    name = Path(path.name.partition("#")[0])
    return name.suffix.lower() in _SSP or path.is_dir() or path.with_name(name.name or ".").is_dir()


def _refuse_controller(source: str, controller: str | None) -> None:
    if controller is not None:
        raise CommandError(f"'{source}' has its own gains; --controller is for built-in systems.")


@contextlib.contextmanager
def _from_file(path: Path, controller: str | None) -> Iterator[Scenario]:
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise CommandError(f"the scenario '{path}' cannot be read: {error.strerror}.") from error
    except UnicodeDecodeError as error:
        raise CommandError(f"the scenario '{path}' is not a text in UTF-8.") from error
    read = parse_scenario(text, str(path), path.parent)
    if read.system in SYSTEMS:
        usual = _built_in(read.system)
        chosen = controller or read.controller or usual.controller or _DEFAULT_CONTROLLER
        yield _scenario(path.stem, _with_times(read, usual), built_in_system(read.system, chosen), None)
        return
    file = path.parent / read.system
    if not _is_ssp(file):
        raise CommandError(
            f"the scenario '{path}' names the system '{read.system}', which is neither an SSP nor one of "
            f"{listed(SYSTEMS)}."
        )
    _refuse_controller(str(path), controller or read.controller)
    with read_ssp(file) as document:
        yield _scenario(path.stem, read, document.system, document)


def _with_times(read: ScenarioFile, usual: ScenarioFile) -> ScenarioFile:
    """What a file says, and the times of another one where it says nothing."""
    return replace(
        read,
        stop_time=_first(read.stop_time, usual.stop_time),
        step_size=_first(read.step_size, usual.step_size),
    )


def _scenario(name: str, read: ScenarioFile, system: System, document: Document | None) -> Scenario:
    """A scenario of what its file says, then what its SSP says."""
    start, stop, step = (
        (document.start_time, document.stop_time, document.step_size) if document else (None, None, None)
    )
    return Scenario(
        name=name,
        description=read.description or (document.description if document else ""),
        system=system,
        start_time=_first(read.start_time, start) or 0.0,
        stop_time=_first(read.stop_time, stop),
        step_size=_first(read.step_size, step),
        algorithm=read.algorithm or "gauss-seidel",
        settings=read.settings,
        notes=document.notes if document else (),
        unpacked=document.unpacked if document else None,
    )


def _first(*values: float | None) -> float | None:
    return next((v for v in values if v is not None), None)
