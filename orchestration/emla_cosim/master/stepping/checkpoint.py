"""Save a run in a file, and continue it from there bit for bit."""

import json
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any

import numpy as np

from ...base.arrays import Vector
from ...base.errors import CommandError
from ...base.files import CURRENT_FOLDER
from ...base.output_files import OutputFile
from ..algorithms.algorithm import Algorithm, require
from ..network import Network
from .stepping_base import Stepping


class Snapshot:
    """Copies of the states of all instances, and of what else a step changes.

    Args:
        algorithm: The algorithm, after `setup`.
        learned: Whether also what is learned of loops is restored, so that a repeated step has the same bits.
    """

    def __init__(self, algorithm: Algorithm, learned: bool = False) -> None:
        self._algorithm, self._members = algorithm, algorithm.network.instances
        self._states: list[Any] = [None] * len(self._members)
        self._values = algorithm.block if learned else algorithm.restored
        self._copy, self._steps = self._values.copy(), algorithm.steps

    def save(self) -> None:
        """Save the present state."""
        self._states = [s.save(state) for s, state in zip(self._members, self._states, strict=True)]
        self._copy[:], self._steps = self._values, self._algorithm.steps

    def restore(self) -> None:
        """Restore the saved state."""
        for instance, state in zip(self._members, self._states, strict=True):
            instance.restore(state)
        self._values[:], self._algorithm.steps = self._copy, self._steps

    def close(self) -> None:
        """Free the copies; never raises."""
        for instance, state in zip(self._members, self._states, strict=True):
            if state is not None:
                instance.forget(state)
        self._states = [None] * len(self._members)


FORMAT = 8
_STATE, _STEP_VALUES = "state/", "memory/"


@dataclass(frozen=True)
class Checkpoint:
    """The content of a checkpoint.

    Args:
        states: State of each FMU, by the name of its instance.
        memory: What steps have changed, by name; see `Stepping.state_dict`.
        notes: Plain data of the caller.
    """

    states: Mapping[str, bytes]
    memory: Mapping[str, Vector]
    notes: Mapping[str, Any]

    def restore(self, stepping: Stepping) -> None:
        """Restore an initialized simulation of the same system; InstanceError if an FMU rejects its state."""
        network = stepping.algorithm.network
        for instance in network.instances:
            instance.deserialize(self.states[instance.name])
        stepping.load_state_dict(self.memory)


def check_checkpoint(path: Path, overwrite: bool, folder: Path = CURRENT_FOLDER) -> OutputFile:
    """Return the file of a checkpoint whose path is relative to `folder`.

    Raises:
        CommandError: The file cannot be written, or another file is there and `overwrite` is false.
    """
    return OutputFile(path, "the checkpoint", _is_checkpoint, overwrite, folder)


def prepare_checkpoint(path: Path, network: Network, folder: Path, overwrite: bool = False) -> OutputFile:
    """Return the file of a checkpoint, relative to `folder`, and let the instances step so that it is exact.

    Raises:
        CommandError: An instance cannot serialize its state, or the file cannot be written; see
            `check_checkpoint`.
    """
    file = check_checkpoint(path, overwrite, folder)
    try:
        # now: a long run should not fail at its first checkpoint
        with TemporaryFile(dir=file.real_path.parent):
            pass
    except OSError as error:
        raise CommandError(f"the checkpoint '{path}' cannot be written: {error.strerror}.") from error
    require(network.instances, "serializes", "canSerializeFMUstate", "a checkpoint")
    for instance in network.instances:
        instance.prepare_checkpoints()
    return file


def save_checkpoint(file: OutputFile, stepping: Stepping, notes: Mapping[str, Any]) -> None:
    """Write a checkpoint. It replaces an earlier file only when it is complete.

    Args:
        file: The file.
        stepping: The simulation.
        notes: Plain data of the caller, returned by `load_checkpoint`.

    Raises:
        RunError: The file cannot be written.
        InstanceError: An FMU cannot save its state.
    """
    network = stepping.algorithm.network
    content: dict[str, Any] = {
        _STATE + s.name: np.frombuffer(s.serialize(), dtype=np.uint8) for s in network.instances
    }
    content |= {_STEP_VALUES + name: value for name, value in stepping.state_dict().items()}
    header = json.dumps({"format": FORMAT, "notes": notes, "arrays": list(content)})
    content["header"] = np.frombuffer(header.encode(), dtype=np.uint8)
    with file.open() as stream:
        np.savez(stream, allow_pickle=False, **content)


def load_checkpoint(path: Path, folder: Path = CURRENT_FOLDER) -> Checkpoint:
    """Read a checkpoint whose path is relative to `folder`.

    Raises:
        CommandError: It is not a checkpoint, is damaged, or has the format of another version.
    """
    file_path = folder / path
    if not file_path.is_file():
        raise CommandError(f"there is no checkpoint '{path}'.")
    try:
        header, arrays = _read_archive(file_path)
        version, notes, names = header["format"], header["notes"], sorted(header["arrays"])
    except Exception as error:  # zip, JSON and array readers raise errors of many types
        raise CommandError(f"'{path}' is not a checkpoint, or is damaged: {error}.") from error
    if version != FORMAT:
        raise CommandError(f"the checkpoint '{path}' has the format {version}; this version reads {FORMAT}.")
    if names != sorted(arrays):
        raise CommandError(f"'{path}' is not a checkpoint, or is damaged: parts of it are missing.")
    states = {n.removeprefix(_STATE): arrays[n].tobytes() for n in arrays if n.startswith(_STATE)}
    memory = {n.removeprefix(_STEP_VALUES): arrays[n] for n in arrays if n.startswith(_STEP_VALUES)}
    return Checkpoint(states, memory, notes)


def _is_checkpoint(path: Path) -> bool:
    """Whether a file looks like a checkpoint, of any format, even if its content is damaged."""
    try:
        with zipfile.ZipFile(path) as archive:
            return "header.npy" in archive.namelist()
    except zipfile.BadZipFile:
        return False


def _read_archive(path: Path) -> tuple[dict[str, Any], dict[str, Vector]]:
    """Read the header and the arrays of a file; ValueError if its checksums are wrong."""
    with zipfile.ZipFile(path) as archive:
        if (damaged := archive.testzip()) is not None:
            raise ValueError(f"{damaged} has changed")
    with np.load(path, allow_pickle=False) as content:  # pickles from others could run any code
        header = json.loads(content["header"].tobytes())
        return header, {n: content[n] for n in content if n != "header"}
