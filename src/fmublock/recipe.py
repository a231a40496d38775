"""The content of an FMU, and the key that tells whether a finished one is up to date.

Nothing here imports CasADi, so that an FMU that is up to date costs little time.
"""

import hashlib
import inspect
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from .block import Block
from .disclosure import Disclosure
from .errors import BuildError, DisclosureError, VersionError
from .platforms import FMI_VERSIONS
from .sources import gather_sources, module_of
from .variables import Parameter

FLAVOURS = ("native", "python")
"""Native FMUs need nothing else to run. PythonFMU FMUs need a Python host and are readable inside."""

LS_REF = "org.fmi-standard.fmi-ls-ref"
"""Name of the layered standard that lists related files with their roles."""

RELATED = f"extra/{LS_REF}"
"""Folder of related files in an FMU."""

RELATED_LIST = f"{RELATED}/fmi-ls-manifest.xml"
"""File in an FMU that lists them."""


@dataclass(frozen=True)
class Producer:
    """Producer of an FMU, as its model description names it.

    Args:
        tool: generation tool.
        version: version of the tool or of the model.
        license: license of the content.
    """

    tool: str = "EMLA-Cosim fmublock"
    version: str | None = None
    license: str | None = None


@dataclass(frozen=True)
class RelatedFile:
    """A related file of an FMU, with its role.

    Args:
        name: file name.
        text: its content.
        role: a role of FMI-LS-REF, such as `result`.
        type: MIME type.
        description: one line for users.
    """

    name: str
    text: str
    role: str
    type: str
    description: str


@dataclass(frozen=True)
class Documents:
    """Texts to include in an FMU.

    Args:
        readme: page in Markdown. Default: the docstring of the block. A table of the variables follows it.
        license: text of the license.
        related: further files with their roles, such as reference results.
    """

    readme: str | None = None
    license: str | None = None
    related: Sequence[RelatedFile] = ()


@dataclass(frozen=True)
class Recipe:
    """All that determines the content of an FMU, except for its platforms."""

    block: Block
    flavour: str
    producer: Producer = Producer()
    documents: Documents = Documents()
    sources: bool = True
    fmi: int = 2
    clock: float | None = None

    @classmethod
    def of(
        cls,
        block: Block | type[Block],
        flavour: str,
        producer: Producer | None = None,
        documents: Documents | None = None,
        disclosure: Disclosure | None = None,
        fmi: int = 2,
        clock: float | None = None,
    ) -> "Recipe":
        """Make a recipe from a caller's arguments. Raises BuildError if they are wrong."""
        disclosure = disclosure or Disclosure()
        if flavour not in FLAVOURS:
            raise BuildError(f"the flavour '{flavour}' is not supported; choose from {', '.join(FLAVOURS)}.")
        if fmi not in FMI_VERSIONS:
            raise VersionError(
                f"FMI {fmi} is not supported; choose from {', '.join(map(str, FMI_VERSIONS))}."
            )
        if fmi != 2 and flavour != "native":
            raise VersionError(f"PythonFMU builds FMUs for FMI 2.0 only; build a native FMU for FMI {fmi}.0.")
        if clock is not None and fmi == 2:
            raise VersionError("a clock needs FMI 3.0; build the FMU for FMI 3.")
        if clock is not None and not 0.0 < clock < math.inf:
            raise VersionError(f"the interval of a clock must be positive and finite, not {clock:g} s.")
        restricted = disclosure.restrict(_make_block(block))
        if flavour != "native" and (restricted.is_restricted or not disclosure.has_sources):
            raise DisclosureError(
                f"FMUs of the flavour {flavour} contain equations and values as Python files; "
                "build a native FMU."
            )
        has_sources = disclosure.has_sources
        return cls(
            restricted, flavour, producer or Producer(), documents or Documents(), has_sources, fmi, clock
        )

    @property
    def model(self) -> str:
        """The model's name: that of the block's class."""
        return type(self.block).__name__

    def key(self) -> str | None:
        """64 hexadecimal digits that change with all that this FMU is made of.

        These are the block's files and declarations, the documents, and fmublock. The versions of the tools
        do not count: where an FMU is ready, they need not be installed. None if other things count, too:
        the block has instance attributes, is not at the top of a file, reads files, or imports modules that
        are not known here.
        """
        # attributes of an instance can be anything; only declarations can be compared
        if vars(self.block):
            return None
        try:
            sources = gather_sources(type(self.block))
        except BuildError:
            return None
        if sources.foreign or sources.reads_files:
            return None
        settings = self.flavour, self.producer, self.documents, self.sources, self.fmi, self.clock
        parts = [module_of(type(self.block)), repr(settings)]
        parts += [*_describe_declarations(self.block), *_read_fmublock_files()]
        parts += [f"{path}\0{text}" for path, text in sorted(sources.texts.items())]
        digest = hashlib.sha256()
        for part in parts:
            encoded = part.encode()
            # with lengths, so that a text cannot move from one part to the next unnoticed
            digest.update(f"{len(encoded)}\0".encode() + encoded)
        return digest.hexdigest()


def describe_producer() -> str:
    """Return a text that changes with fmublock itself."""
    return "\0".join(_read_fmublock_files())


def _make_block(block: Block | type[Block]) -> Block:
    """Return the checked block of a class or instance. Raises BuildError for anything else."""
    try:
        instance = block() if isinstance(block, type) and issubclass(block, Block) else block
        if not isinstance(instance, Block) or type(instance) is Block:
            raise BuildError(f"{block!r} is not a block; derive a class from fmublock.Block.")
    except TypeError as error:
        raise BuildError(f"{block!r} cannot be built: {error}.") from error
    try:
        instance.layout()
    except TypeError as error:
        raise BuildError(f"{error}.") from error
    if not re.fullmatch(r"[A-Za-z_]\w*", type(instance).__name__, re.ASCII):
        raise BuildError(
            f"the class {type(instance).__name__} needs a name of the letters A to Z, digits and _."
        )
    return instance


def _describe_declarations(block: Block) -> list[str]:
    """Return the present declarations of a class: its variables and its texts."""
    layout = block.layout()
    variables = dict.fromkeys(scalar.variable for scalar in layout.scalars)
    attributes = [{k: _replace_by_name(x) for k, x in vars(v).items()} for v in variables]
    kinds = [type(v).__name__ for v in variables]
    text = inspect.cleandoc(block.__doc__ or "")  # Python 3.13 removes indentation when it compiles
    return [repr((type(block).__qualname__, text, block.default_experiment, kinds)), repr(attributes)]


def _replace_by_name(value: Any) -> Any:
    """Replace parameters in a variable's attributes by their names."""
    if isinstance(value, tuple):
        return tuple(_replace_by_name(x) for x in value)
    return value.attribute if isinstance(value, Parameter) else value


@cache
def _read_fmublock_files() -> tuple[str, ...]:
    """Return the contents of fmublock's own files, which build FMUs and are part of them."""
    folder = Path(__file__).parent
    files = sorted(f for f in folder.rglob("*") if f.suffix in (".py", ".c", ".h"))
    return tuple(f"{f.relative_to(folder).as_posix()}\0{f.read_text(encoding='utf-8')}" for f in files)
