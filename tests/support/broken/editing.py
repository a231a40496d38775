"""A good FMU with one thing changed: a file of it, its model description, or the archive."""

import io
import tempfile
import warnings
import zipfile
from collections.abc import Callable, Iterable
from functools import cache
from pathlib import Path

from lxml import etree

from tests.support.toy_fmu import copy_toy

DESCRIPTION = "modelDescription.xml"
Files = dict[str, bytes]
Build = Callable[[Path], Path]
Edit = Callable[[etree._Element], object]


@cache
def good_bytes(fmi: int = 2, clock: float | None = None) -> bytes:
    """An FMU that passes all checks: the toy, for both kinds of a version of FMI, or with a clock."""
    with tempfile.TemporaryDirectory() as folder:
        return copy_toy(Path(folder, "Toy.fmu"), fmi, clock).read_bytes()


def good_files(fmi: int = 2, clock: float | None = None) -> Files:
    """What is in it, by path."""
    return read_files(good_bytes(fmi, clock))


def read_files(content: bytes) -> Files:
    """The files of an archive, by path."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def written(path: Path, files: Iterable[tuple[str | zipfile.ZipInfo, bytes]]) -> Path:
    """An archive of these entries."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of names that stand twice
        for name, content in files:
            archive.writestr(name, content)
    return path


def with_files(edit: Callable[[Files], object], fmi: int = 2, clock: float | None = None) -> Build:
    """Builds the good FMU with files that `edit` changed."""

    def build(folder: Path) -> Path:
        files = good_files(fmi, clock)
        edit(files)
        return written(folder / "Toy.fmu", files.items())

    return build


def with_text(old: str, new: str, file: str = DESCRIPTION, fmi: int = 2) -> Build:
    """Builds the good FMU with one text in place of another, which has to be there."""

    def edit(files: Files) -> None:
        assert old.encode() in files[file], f"{old} is not in {file}"
        files[file] = files[file].replace(old.encode(), new.encode())

    return with_files(edit, fmi)


def set_attributes(path: str, **attributes: str | None) -> Edit:
    """Change attributes of all elements at a path, of which there has to be one; None removes one."""

    def edit(root: etree._Element) -> None:
        elements = root.xpath(path)
        assert elements, f"{path} leads nowhere"
        for element in elements:
            for name, value in attributes.items():
                if value is None:
                    del element.attrib[name]
                else:
                    element.set(name, value)

    return edit


def remove(path: str) -> Edit:
    """Remove all elements at a path."""
    return lambda root: [element.getparent().remove(element) for element in root.xpath(path)]


def append(parent: str, element: str) -> Edit:
    """Append an element to another one."""
    return lambda root: root.find(parent).append(etree.fromstring(element))


def with_tree(*edits: Edit, fmi: int = 2) -> Build:
    """Builds the good FMU with a model description that `edits` changed."""

    def change(files: Files) -> None:
        root = etree.fromstring(files[DESCRIPTION])
        for edit in edits:
            edit(root)
        files[DESCRIPTION] = etree.tostring(root, encoding="UTF-8", xml_declaration=True)

    return with_files(change, fmi)


def setting(path: str, fmi: int = 2, **attributes: str | None) -> Build:
    """Builds the good FMU with attributes of an element changed; those that are None are taken away."""
    return with_tree(set_attributes(path, **attributes), fmi=fmi)


def without(path: str, fmi: int = 2) -> Build:
    """Builds the good FMU without an element."""
    return with_tree(remove(path), fmi=fmi)
