"""Files that a command may be given, good and bad."""

import os
import stat
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

ODD = "[bold]é\"',;#&<x> µ"
"""A name that has something to say to every format we write."""


@dataclass(frozen=True)
class Materials:
    """Files that are as they should be."""

    fmus: Path
    package: Path
    checkpoint: Path

    @property
    def fmu(self) -> Path:
        return self.fmus / "EmlaPlant/EmlaPlant.fmu"


RECORD = b'{"settings": {}, "source": "lift", "changed": {"stop_time": 0.002}}\n'
TOML = b'description = "x"\nsystem = "lift"\nstop_time = 0.002\nplots = false\n'
BLOCK = (
    b"from fmublock import Block, Output\n\nclass B(Block):\n    y = Output()\n    def outputs(self, v):\n"
)
Make = Callable[[Path, Materials], object]


def _with(content: bytes) -> Make:
    return lambda path, _: path.write_bytes(content)


def _part(which: str, part: float, flip: bool = False) -> Make:
    def make(path: Path, materials: Materials) -> None:
        content = bytearray(getattr(materials, which).read_bytes())
        if flip:
            content[int(part * len(content))] ^= 0x55
        path.write_bytes(content if flip else content[: int(part * len(content))])

    return make


def _device(path: Path, _: Materials) -> None:
    """One that takes and gives nothing; a folder where we may make none."""
    try:
        os.mknod(path, stat.S_IFCHR | 0o600, os.makedev(1, 3))
    except OSError:
        path.mkdir()


_EXTENSIONS = ("toml", "ssp", "ssd", "fmu", "ssv", "ssm", "py", "c", "json", "png")
FILES: dict[str, Make] = {
    "folder": lambda path, _: path.mkdir(),
    "folder.ssp": lambda path, _: path.mkdir(),
    "device": _device,
    "device.toml": _device,
    "dangling": lambda path, _: path.symlink_to("gone"),
    "dangling.ssp": lambda path, _: path.symlink_to("gone/gone"),
    "loop": lambda path, _: path.symlink_to(path.name),
    "loop.toml": lambda path, _: path.symlink_to(path.name),
    "link.ssp": lambda path, materials: path.symlink_to(materials.package),
    "ok.toml": _with(TOML),
    "bom.toml": _with(b"\xef\xbb\xbf" + TOML),
    "latin.toml": _with(TOML.replace(b"x", b"\xb5")),
    "nul.toml": _with(TOML + b"\0"),
    "utf16.toml": _with(TOML.decode().encode("utf-16")),
    "deep.toml": _with(b"set = " + b"[" * 5000),
    "huge.toml": _with(TOML + b"step_size = 1" + b"0" * 5000 + b"\n"),
    f"{ODD}.toml": _with(TOML),
    "block.py": _with(BLOCK + b"        return {'y': 1.0}\n"),
    "broken.py": _with(BLOCK),
    "ok.json": _with(RECORD),
    "device.json": _device,
    "odd.json": _with(RECORD.replace(b"0.002", b"1e999")),
    "cut.json": _with(RECORD[:-9]),
    "ok.ssp": _part("package", 1.0),
    "ok.fmu": _part("fmu", 1.0),
    "ok.checkpoint": _part("checkpoint", 1.0),
    **{f"{kind}-{part}.{end}": _part(kind, part, flip)
       for kind, end in (("package", "ssp"), ("fmu", "fmu"), ("checkpoint", "checkpoint"))
       for part, flip in ((0.1, False), (0.9, False), (0.3, True), (0.6, True), (0.99, True))},
    **{f"empty.{end}": _with(b"") for end in _EXTENSIONS},
    **{f"binary.{end}": _with(bytes(range(256)) * 8) for end in _EXTENSIONS},
}  # fmt: skip
"""How each file is made that commands may name."""
