"""Access to the files of an SSP: a package, a folder, or an SSD with its resources."""

import contextlib
import posixpath
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from urllib.parse import unquote, urlsplit

from ...base.errors import CommandError, join_names, raise_machine_fault, show_paths_relative_to
from ...base.faults import accept_if_lenient
from ...base.files import temporary_folder
from ...fmu.file import UnsafeArchiveError, unpack
from ..documents.ssd_data import DEFAULT_SSD

_LARGEST_INSIDE = 2**26
"""The largest size of a parameter file inside an FMU in bytes."""


@dataclass(frozen=True)
class Package:
    """An SSD, and the folder that its files must be in.

    Attributes:
        folder: The folder.
        ssd: The SSD to read.
        name: The name in error messages.
        unpacked: The temporary folder with the unpacked package, if there is one.
    """

    folder: Path
    ssd: Path
    name: str
    unpacked: Path | None = None

    def file(self, uri: str, where: str) -> Path:
        """Return the path of a file.

        Args:
            uri: A URI relative to the folder of the SSD.
            where: The document with the URI, for error messages.

        Raises:
            CommandError: If the URI is not relative, or the file does not exist or is outside the folder.
        """
        path = _parse_relative(uri)
        if path is None:
            raise CommandError(
                f"'{where}' names '{uri}', but only relative URIs inside the package can be read."
            )
        file = (self.ssd.parent / path).resolve()
        if not file.is_relative_to(self.folder.resolve()):
            outside = f"'{where}' names '{uri}', which is outside the package"
            if self.unpacked is not None or not file.is_file():  # an archive must not reach other files
                raise CommandError(f"{outside}.")
            accept_if_lenient(where, f"'{uri}' is outside the package", outside)
        if not file.is_file():
            raise CommandError(f"'{where}' names the file '{uri}', which does not exist.")
        return file


def _parse_relative(uri: str) -> str | None:
    """Return the path of a relative URI, None for other URIs."""
    try:
        parts = urlsplit(uri)
    except ValueError:
        return None
    path = unquote(parts.path)
    strange = parts.scheme or parts.netloc or path.startswith("/") or "\\" in path or "\0" in path
    return None if strange else path


@contextlib.contextmanager
def open_package(path: Path, variant: str = "") -> Iterator[Package]:
    """Open a package (.ssp), a folder, or an SSD; unpacked files are removed at the end of the block.

    Args:
        path: The file or folder; `PACKAGE#Variant.ssd` selects a variant, too.
        variant: The name of an SSD other than SystemStructure.ssd.

    Raises:
        CommandError: If there is no SSD to read.
    """
    file, variant = (path, variant) if variant else _split_variant(path)
    name = f"{file}#{variant}" if variant else str(file)
    if file.is_dir():
        yield _find_ssd(file, variant, name)
    elif not file.is_file():
        raise CommandError(f"there is no file '{file}'.")
    elif file.suffix.lower() == ".ssd":
        yield Package(file.parent, file, file.name)
    else:
        with temporary_folder("ssp") as temporary, show_paths_relative_to(temporary):
            folder = temporary / file.name
            try:
                unpack(file, folder)
            except UnsafeArchiveError as error:
                raise CommandError(f"the package '{file}' {error}.") from error
            except OSError as error:
                raise CommandError(f"'{file}' cannot be unpacked: {error.strerror or error}.") from error
            except Exception as error:  # zipfile raises many types
                raise CommandError(f"'{file}' is not an SSP that can be read: {error}.") from error
            yield replace(_find_ssd(folder, variant, name), unpacked=temporary)


def _split_variant(path: Path) -> tuple[Path, str]:
    if path.exists():
        return path, ""
    name, hash_, variant = path.name.partition("#")
    return (path.with_name(name), variant) if hash_ and name else (path, "")


def _find_ssd(folder: Path, variant: str, name: str) -> Package:
    ssd = folder / (variant or DEFAULT_SSD)
    # neither `#../other.ssd` nor a link leads out of the package
    if not ssd.is_file() or ssd.resolve().parent != folder.resolve():
        present = sorted(p.name for p in folder.glob("*.ssd"))
        instead = (
            f"it has {join_names(present)}; write '{name.partition('#')[0]}#{present[0]}'"
            if present
            else ("an SSP has one at its top")
        )
        raise CommandError(f"'{name}' has no '{ssd.name}'; {instead}.")
    return Package(folder, ssd, variant or ssd.name)


def read_inside_fmu(fmu: Path, uri: str, where: str) -> bytes:
    """Return the content of a file inside an FMU.

    Args:
        fmu: The FMU file.
        uri: The path inside the FMU.
        where: The document with the URI, for error messages.

    Raises:
        CommandError: If the file does not exist or cannot be read.
    """
    try:
        with zipfile.ZipFile(fmu) as archive:
            entry = archive.getinfo(posixpath.normpath(unquote(uri)))
            if entry.file_size <= _LARGEST_INSIDE:
                return archive.read(entry)
    except KeyError as error:
        raise CommandError(
            f"'{where}' names the file '{uri}' inside '{fmu.name}', which does not exist."
        ) from error
    except Exception as error:  # zipfile raises many types
        raise_machine_fault(error, f"'{uri}' inside '{fmu.name}'")
        raise CommandError(f"'{uri}' inside '{fmu.name}' cannot be read: {error}.") from error
    raise CommandError(f"'{uri}' inside '{fmu.name}' is larger than {_LARGEST_INSIDE // 2**20} MiB.")
