"""The FMU under examination, as checks see it."""

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
    """An FMU file, the folder that it is unpacked to, and how it is to be examined.

    What is read from it is read when it is first asked for, and may fail in any way until the checks
    that it needs have passed: `archive.safe` for the folder, `description.readable` for everything
    that stands in the model description.
    """

    path: Path
    folder: Path
    settings: Settings = field(default_factory=Settings)

    def __reduce__(self) -> Any:
        """As it goes to a process that has nothing of this one: without what was read."""
        return type(self), (self.path, self.folder, self.settings)

    @cached_property
    def tree(self) -> Any:
        """The root element of the model description."""
        parser = etree.XMLParser(resolve_entities=False, no_network=True)
        with zipfile.ZipFile(self.path) as archive:
            return etree.fromstring(archive.read(DESCRIPTION), parser)

    @cached_property
    def description(self) -> ModelDescription:
        """The model description as fmpy reads it, not validated."""
        return fmpy.read_model_description(str(self.path), validate=False)

    @cached_property
    def declared(self) -> Declarations:
        """What the model description declares, as far as the schema goes: needs `description.schema`."""
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
        """What the FMU is for: `CoSimulation`, `ModelExchange`, or both, in this order."""
        return [name for name in ("CoSimulation", "ModelExchange") if self.tree.find(name) is not None]

    def find_kind_element(self, kind: str) -> Any:
        """The element of the model description for a kind, as fmpy reads it; None where the FMU has none."""
        description = self.description
        return description.coSimulation if kind == "CoSimulation" else description.modelExchange

    def has_capability(self, capability: str, kind: str | None = None) -> bool:
        """Whether the FMU claims a capability, as `canGetAndSetFMUstate`, for a kind or its first one."""
        return bool(getattr(self.find_kind_element(kind or self.kinds[0]), capability, False))

    def library(self, kind: str | None = None) -> Path | None:
        """The shared library for this machine; None where there is none."""
        return find_library(self.folder, self.find_kind_element(kind or self.kinds[0]).modelIdentifier)

    def of_causality(self, *causalities: str, kind: str = "Real") -> list[ModelVariable]:
        """Variables of these causalities and of a type, in the order of the model description."""
        found = self.description.modelVariables
        return [v for v in found if v.causality in causalities and v.type == kind]
