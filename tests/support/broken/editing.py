"""A good FMU with one thing changed: a file of it, its model description, or the archive."""

import io
import tempfile
import warnings
import zipfile
from collections.abc import Callable, Iterable
from functools import cache
from pathlib import Path

from lxml import etree

from tests.support.toy_fmu import build_toy

DESCRIPTION = "modelDescription.xml"
Files = dict[str, bytes]
Build = Callable[[Path], Path]


@cache
def good_bytes(fmi: int = 2, clock: float | None = None) -> bytes:
    """An FMU that passes all checks: the toy, for both kinds of a version of FMI, or with a clock."""
    with tempfile.TemporaryDirectory() as folder:
        return build_toy("native", Path(folder, "Toy.fmu"), fmi=fmi, clock=clock).read_bytes()


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


def with_files(
    edit: Callable[[Files], object], fmi: int = 2, clock: float | None = None
) -> Callable[[Path], Path]:
    """Builds the good FMU with files that `edit` changed."""

    def build(folder: Path) -> Path:
        files = good_files(fmi, clock)
        edit(files)
        return written(folder / "Toy.fmu", files.items())

    return build


def with_text(old: str, new: str, file: str = DESCRIPTION, fmi: int = 2) -> Callable[[Path], Path]:
    """Builds the good FMU with one text in place of another, which has to be there."""

    def edit(files: Files) -> None:
        assert old.encode() in files[file], f"{old} is not in {file}"
        files[file] = files[file].replace(old.encode(), new.encode())

    return with_files(edit, fmi)


def with_tree(edit: Callable[[etree._Element], object], fmi: int = 2) -> Callable[[Path], Path]:
    """Builds the good FMU with a model description that `edit` changed."""

    def change(files: Files) -> None:
        root = etree.fromstring(files[DESCRIPTION])
        edit(root)
        files[DESCRIPTION] = etree.tostring(root, encoding="UTF-8", xml_declaration=True)

    return with_files(change, fmi)


def setting(path: str, fmi: int = 2, **attributes: str | None) -> Callable[[Path], Path]:
    """Builds the good FMU with attributes of an element changed; those that are None are taken away."""

    def edit(root: etree._Element) -> None:
        found = root.xpath(path)
        assert found, f"{path} leads nowhere"
        for element in found:
            for name, value in attributes.items():
                if value is None:
                    del element.attrib[name]
                else:
                    element.set(name, value)

    return with_tree(edit, fmi)


def without(path: str, fmi: int = 2) -> Callable[[Path], Path]:
    """Builds the good FMU without an element."""

    def edit(root: etree._Element) -> None:
        (element,) = root.xpath(path)
        element.getparent().remove(element)

    return with_tree(edit, fmi)
