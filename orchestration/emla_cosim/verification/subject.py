"""The FMU under examination."""

import sys
import zipfile
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import fmpy
from fmpy.model_description import ModelDescription, ModelVariable
from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]

from ..fmu.interface import Interface
from ..fmu.shared_library import find_library
from .declarations import Declarations, read_declarations
from .settings import Settings

DESCRIPTION = "modelDescription.xml"


@dataclass
class Subject:
    """An FMU file, the folder that it is unpacked to, and the settings.

    Properties read the file on first use. They may raise any exception before these checks have passed:
    `archive.safe` for the folder, `description.readable` for the content of the model description.
    """

    path: Path
    folder: Path
    settings: Settings = field(default_factory=Settings)
    most_steps: int = sys.maxsize
    """Most steps of one run: a slow FMU is run for fewer steps than others."""

    def __reduce__(self) -> Any:
        """Pickle without what was read."""
        return type(self), (self.path, self.folder, self.settings, self.most_steps)

    @property
    def scratch(self) -> Path:
        """The folder in which checks work, with that of the unpacked FMU in it."""
        return self.folder.parent

    @cached_property
    def tree(self) -> Any:
        """The root element of the model description."""
        parser = etree.XMLParser(resolve_entities=False, no_network=True)
        with zipfile.ZipFile(self.path) as archive:
            return etree.fromstring(archive.read(DESCRIPTION), parser)

    @cached_property
    def description(self) -> ModelDescription:
        """The model description from fmpy, not validated."""
        return fmpy.read_model_description(str(self.path), validate=False)

    @cached_property
    def declared(self) -> Declarations:
        """The declarations of the model description. Needs `description.schema`."""
        return read_declarations(self.tree)

    @cached_property
    def interface(self) -> Interface:
        """Variables and units by name."""
        return Interface(self.description)

    @property
    def variables(self) -> dict[str, ModelVariable]:
        """Variables by name."""
        return self.interface.variables

    @property
    def kinds(self) -> list[str]:
        """The kinds of the FMU: `CoSimulation`, `ModelExchange`, or both, in this order."""
        return [name for name in ("CoSimulation", "ModelExchange") if self.tree.find(name) is not None]

    def find_kind_element(self, kind: str) -> Any:
        """Return fmpy's element of the model description for a kind, or None."""
        description = self.description
        return description.coSimulation if kind == "CoSimulation" else description.modelExchange

    def has_capability(self, capability: str, kind: str | None = None) -> bool:
        """Return whether a flag such as `canGetAndSetFMUstate` is set, by default for the first kind."""
        return bool(getattr(self.find_kind_element(kind or self.kinds[0]), capability, False))

    def library(self, kind: str | None = None) -> Path | None:
        """Return the shared library for this machine, or None."""
        return find_library(self.folder, self.find_kind_element(kind or self.kinds[0]).modelIdentifier)

    def of_causality(self, *causalities: str, kind: str = "Real") -> list[ModelVariable]:
        """Return the variables of these causalities and a type, in the order of the model description."""
        found = self.description.modelVariables
        return [v for v in found if v.causality in causalities and v.type == kind]
