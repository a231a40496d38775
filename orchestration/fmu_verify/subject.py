"""The FMU under examination."""

import sys
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import fmpy
from fmpy.model_description import ModelDescription, ModelVariable

from emla_cosim.fmu.document import FmuDocument, find_attribute_fault
from emla_cosim.fmu.elements import CLOCK, InputClock, read_input_clocks, split_arrays
from emla_cosim.fmu.file import find_library
from emla_cosim.fmu.interface import Interface, read_with_fmpy

from .check import FLAGS
from .declarations import Declarations, read_declarations
from .messages import shorten_sentence
from .settings import Settings


@dataclass(frozen=True)
class WholeSystem:
    """A system of FMUs, the settings for its check, and the folder in which it works."""

    path: Path
    settings: Settings
    scratch: Path


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
    def document(self) -> FmuDocument:
        """The description of the FMU as a whole."""
        return FmuDocument(self.path)

    @cached_property
    def tree(self) -> Any:
        """The root element of the model description."""
        return self.document.root

    @property
    def version(self) -> int:
        """The version of FMI: 3 for FMI 3.0, otherwise 2."""
        return self.document.version

    @property
    def known_version(self) -> int:
        """The version of FMI as far as the model description was read."""
        return self.version if "tree" in vars(self) else 2

    def read_description(self) -> ModelDescription:
        """Read the model description with fmpy, without a validation."""
        return fmpy.read_model_description(str(self.path), validate=False)

    @cached_property
    def description(self) -> ModelDescription:
        """The model description from fmpy, not validated.

        Variables of FMI 3.0 are split into elements, with the types of FMI 2.0, without Clocks and Binary.
        """
        description = read_with_fmpy(self.path, validate=False)
        if self.version == 3:
            split_arrays(description)
        return description

    @cached_property
    def description_problem(self) -> str:
        """Why `description` cannot be read, as a message; empty if it can."""
        try:
            _ = self.description
        except MemoryError:
            raise
        except Exception as error:
            fault = find_attribute_fault(self.path) or str(error)
            return f"The model description cannot be read: {shorten_sentence(fault).rstrip('.')}."
        return ""

    @cached_property
    def declared(self) -> Declarations:
        """The declarations of the model description. Needs `description.schema`."""
        return read_declarations(self.tree, self.version)

    @cached_property
    def interface(self) -> Interface:
        """Variables and units by name."""
        return Interface(self.description)

    @cached_property
    def has_clocks(self) -> bool:
        """Whether the FMU has Clocks."""
        return self.version == 3 and self.tree.find("ModelVariables/Clock") is not None

    @cached_property
    def input_clocks(self) -> list[InputClock]:
        """The Clocks that a host ticks. Needs `description.schema`."""
        if self.version != 3:
            return []
        return read_input_clocks(self.folder, self.path)

    @cached_property
    def clocks(self) -> list[ModelVariable]:
        """All Clocks, which `variables` lack."""
        return [v for v in self.read_description().modelVariables if v.type == CLOCK]

    @property
    def variables(self) -> dict[str, ModelVariable]:
        """Variables by name."""
        return self.interface.variables

    @property
    def kinds(self) -> list[str]:
        """The kinds of the FMU: `CoSimulation`, `ModelExchange`, and that of FMI 3.0, in this order."""
        return self.document.kinds

    @property
    def run_kinds(self) -> list[str]:
        """The kinds as which the FMU runs: models with Clocks are not integrated."""
        return [kind for kind in self.kinds if not (kind == "ModelExchange" and self.has_clocks)]

    def find_kind_element(self, kind: str) -> Any:
        """Return fmpy's element of the model description for a kind, or None."""
        return getattr(self.description, f"{kind[0].lower()}{kind[1:]}")

    def has_capability(self, capability: str, kind: str | None = None) -> bool:
        """Return whether a flag is set, by its name in FMI 2.0, by default for the first kind."""
        kind = kind or self.kinds[0]
        if self.version == 3:  # fmpy (0.3.32) does not read all of them
            return self.has_flag(FLAGS.get(capability, capability), kind)
        return bool(getattr(self.find_kind_element(kind), capability, False))

    def has_flag(self, flag: str, kind: str | None = None) -> bool:
        """Return whether the element of a kind, by default the first one, has an attribute that is true."""
        return flag in self.document.list_flags(kind or self.kinds[0])

    def library(self, kind: str | None = None) -> Path | None:
        """Return the shared library for this machine, or None."""
        return find_library(self.folder, self.find_kind_element(kind or self.kinds[0]).modelIdentifier)

    def of_causality(self, *causalities: str, kind: str = "Real") -> list[ModelVariable]:
        """Return the variables of these causalities and one type, by default Real, in their order."""
        variables = self.description.modelVariables
        return [v for v in variables if v.causality in causalities and v.type == kind]
