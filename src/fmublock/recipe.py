"""What an FMU is made of, and the key by which a finished one is known to be up to date.

Nothing here needs what builds FMUs: whether one is current is known before CasADi is imported.
"""

import hashlib
import re
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from .block import Block
from .errors import BuildError
from .sources import gather_sources, module_of
from .variables import Parameter

FLAVOURS = ("native", "python")
"""Native FMUs run anywhere; PythonFMU FMUs need a Python host and are readable inside."""

_TOOLS = ("casadi", "fmpy", "latex2mathml", "markdown-it-py", "matplotlib", "mdit-py-plugins")
_FLAVOUR_TOOLS = {"native": ("ziglang",), "python": ("pythonfmu",)}


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
class Documents:
    """Texts to include in an FMU.

    Args:
        readme: page in Markdown. Default: the docstring of the block. A table of the variables follows it.
        license: text of the license.
    """

    readme: str | None = None
    license: str | None = None


@dataclass(frozen=True)
class Recipe:
    """Everything that decides the content of an FMU, except for its platforms."""

    block: Block
    flavour: str
    producer: Producer = Producer()
    documents: Documents = Documents()

    @classmethod
    def of(
        cls,
        block: Block | type[Block],
        flavour: str,
        producer: Producer | None = None,
        documents: Documents | None = None,
    ) -> "Recipe":
        """A recipe for what a caller asked for. Raises BuildError where that makes no sense."""
        if flavour not in FLAVOURS:
            raise BuildError(f"there is no flavour '{flavour}'; choose from {', '.join(FLAVOURS)}.")
        return cls(_instance(block), flavour, producer or Producer(), documents or Documents())

    @property
    def model(self) -> str:
        """The model's name, which is the block's."""
        return type(self.block).__name__

    def key(self) -> str | None:
        """64 hexadecimal digits that change with everything this FMU is made of.

        These are the files of the block and what it declares, the documents, fmublock, and the
        versions of the tools. None where that is not all that decides: the block keeps values of
        its own, is not at the top of a file, or imports what is not known here.
        """
        if vars(self.block):
            return None
        try:
            sources = gather_sources(type(self.block))
        except BuildError:
            return None
        if sources.foreign:
            return None
        parts = [module_of(type(self.block)), repr((self.flavour, self.producer, self.documents))]
        parts += [*_declared(self.block), *_own_files()]
        parts += [f"{path}\0{text}" for path, text in sorted(sources.texts.items())]
        parts += [f"{tool} {_version(tool)}" for tool in (*_TOOLS, *_FLAVOUR_TOOLS[self.flavour])]
        digest = hashlib.sha256()
        for part in parts:
            encoded = part.encode()
            digest.update(f"{len(encoded)}\0".encode() + encoded)
        return digest.hexdigest()


def made_by(*tools: str) -> str:
    """A text that changes with fmublock itself and with the versions of these tools."""
    return "\0".join([*_own_files(), *(f"{tool} {_version(tool)}" for tool in tools)])


def _instance(block: Block | type[Block]) -> Block:
    """The block of a class or instance, looked through. Raises BuildError for anything else."""
    try:
        made = block() if isinstance(block, type) and issubclass(block, Block) else block
        if not isinstance(made, Block) or type(made) is Block:
            raise BuildError(f"{block!r} is not a block; derive a class from fmublock.Block.")
        made.layout()
    except TypeError as error:
        raise BuildError(f"{block!r} cannot be built: {error}.") from error
    if not re.fullmatch(r"[A-Za-z_]\w*", type(made).__name__, re.ASCII):
        raise BuildError(f"the class {type(made).__name__} needs a name of the letters A to Z, digits and _.")
    return made


def _declared(block: Block) -> list[str]:
    """What the class says now, whatever made it say so: its variables and its texts."""
    layout = block.layout()
    variables = dict.fromkeys(scalar.variable for scalar in layout.scalars)
    own = [{k: _by_name(x) for k, x in vars(v).items()} for v in variables]
    kinds = [type(v).__name__ for v in variables]
    return [repr((type(block).__qualname__, block.__doc__, block.default_experiment, kinds)), repr(own)]


def _by_name(value: Any) -> Any:
    """What a variable says of itself, with parameters by their names."""
    if isinstance(value, tuple):
        return tuple(_by_name(x) for x in value)
    return value.attribute if isinstance(value, Parameter) else value


@cache
def _own_files() -> tuple[str, ...]:
    """The files of fmublock itself, which make FMUs and are part of them."""
    folder = Path(__file__).parent
    files = sorted(f for f in folder.rglob("*") if f.suffix in (".py", ".c", ".h"))
    return tuple(f"{f.relative_to(folder).as_posix()}\0{f.read_text(encoding='utf-8')}" for f in files)


@cache
def _version(tool: str) -> str:
    from importlib.metadata import PackageNotFoundError, version  # takes a while

    try:
        return version(tool)
    except PackageNotFoundError:
        return "unknown"
