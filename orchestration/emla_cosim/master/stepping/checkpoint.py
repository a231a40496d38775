"""A run put aside in a file, to be continued bit for bit."""

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
from ...base.files import HERE, write_atomically
from ...base.ownership import check_replaceable
from ..algorithms.algorithm import require
from ..network import Network
from .stepping_base import Stepping

FORMAT = 3
_STATE, _MEMORY = "state/", "memory/"


@dataclass(frozen=True)
class Checkpoint:
    """States of all instances by name, what signals and stepping remember, and notes of the caller."""

    states: Mapping[str, bytes]
    memory: Mapping[str, Vector]
    notes: Mapping[str, Any]

    def restore(self, stepping: Stepping) -> None:
        """Bring a simulation of the same system, which has been initialized, to this point.

        Raises InstanceError where an instance does not take its state.
        """
        network = stepping.algorithm.network
        for instance in network.instances:
            instance.deserialize(self.states[instance.name])
        network.signals[:] = self.memory["signals"]
        stepping.remember(self.memory)


def check_checkpoint(path: Path, overwrite: bool, folder: Path = HERE) -> Path:
    """Return where the checkpoint of this path, which is relative to `folder`, will be written.

    Raises CommandError where the file cannot be written, or is no checkpoint and not to be overwritten.
    """
    return check_replaceable(path, "the checkpoint", _is_checkpoint, overwrite, folder)


def checkpoint_place(path: Path, network: Network, folder: Path, overwrite: bool = False) -> Path:
    """Where the checkpoint of this path, which is relative to `folder`, will be written.

    Raises CommandError unless all instances can be put aside, and the file can be written, see
    `check_checkpoint`.
    """
    place = check_checkpoint(path, overwrite, folder)
    try:
        with TemporaryFile(dir=place.parent):
            pass
    except OSError as error:
        raise CommandError(f"the checkpoint '{path}' cannot be written: {error.strerror}.") from error
    require(network.instances, "serializes", "canSerializeFMUstate", "a checkpoint")
    return place


def save_checkpoint(path: Path, stepping: Stepping, notes: Mapping[str, Any]) -> None:
    """Write where a simulation is; `notes` is plain data to find again.

    An earlier file is replaced only when the new one is complete. Raises OSError, InstanceError.
    """
    network = stepping.algorithm.network
    content: dict[str, Any] = {
        _STATE + s.name: np.frombuffer(s.serialize(), dtype=np.uint8) for s in network.instances
    }
    content |= {_MEMORY + name: value for name, value in stepping.memory().items()}
    content[_MEMORY + "signals"] = network.signals
    header = json.dumps({"format": FORMAT, "notes": notes, "arrays": list(content)})
    content["header"] = np.frombuffer(header.encode(), dtype=np.uint8)
    with write_atomically(path) as stream:
        np.savez(stream, allow_pickle=False, **content)


def load_checkpoint(path: Path, folder: Path = HERE) -> Checkpoint:
    """Read a checkpoint, its path relative to `folder`; raises CommandError where the file is none."""
    place = folder / path
    if not place.is_file():
        raise CommandError(f"there is no checkpoint '{path}'.")
    try:
        header, arrays = _read(place)
        form, notes, names = header["format"], header["notes"], sorted(header["arrays"])
    except Exception as error:  # zip, JSON and array readers raise whatever they like
        raise CommandError(f"'{path}' is not a checkpoint, or is damaged: {error}.") from error
    if form != FORMAT:
        raise CommandError(f"the checkpoint '{path}' has the format {form}; this version reads {FORMAT}.")
    if names != sorted(arrays):
        raise CommandError(f"'{path}' is not a checkpoint, or is damaged: parts of it are missing.")
    states = {n.removeprefix(_STATE): arrays[n].tobytes() for n in arrays if n.startswith(_STATE)}
    memory = {n.removeprefix(_MEMORY): arrays[n] for n in arrays if n.startswith(_MEMORY)}
    return Checkpoint(states, memory, notes)


def _is_checkpoint(path: Path) -> bool:
    """Whether a file looks like one, of any format and however damaged inside."""
    try:
        with zipfile.ZipFile(path) as archive:
            return "header.npy" in archive.namelist()
    except (OSError, zipfile.BadZipFile):
        return False


def _read(path: Path) -> tuple[dict[str, Any], dict[str, Vector]]:
    """The header and the arrays of a file, of which not a bit has changed."""
    with zipfile.ZipFile(path) as archive:
        if (damaged := archive.testzip()) is not None:
            raise ValueError(f"{damaged} has changed")
    with np.load(path, allow_pickle=False) as content:
        header = json.loads(content["header"].tobytes())
        return header, {n: content[n] for n in content if n != "header"}
