"""Access to the files of an SSP, and loading of a structure with all that it names."""

import contextlib
import itertools
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
from ...fmu.interface import KINDS
from ...fmu.parameters.parameter_sets import parse_parameter_set
from ..documents.mappings import parse_mapping
from ..documents.ssd_data import (
    DEFAULT_SSD,
    FMU,
    SSD,
    SSP,
    ComponentElement,
    Connector,
    Element,
    FileReference,
    ParameterBinding,
    Structure,
    SystemElement,
)
from ..documents.ssd_reader import parse_structure

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
        yield _make_package(file, variant, name)
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
            yield replace(_make_package(folder, variant, name), unpacked=temporary)


def _split_variant(path: Path) -> tuple[Path, str]:
    """Return the file of `PACKAGE#Variant.ssd` and the variant; empty if the path exists as it is."""
    if path.exists():
        return path, ""
    name, hash_, variant = path.name.partition("#")
    return (path.with_name(name), variant) if hash_ and name else (path, "")


def _make_package(folder: Path, variant: str, name: str) -> Package:
    """Return the package in a folder, with its SSD. Raise CommandError if there is no such SSD at its top."""
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


_DEEPEST = 50
"""The largest depth of nested documents."""
_MOST_COMPONENTS = 10_000
"""The largest number of components; references can turn few into many."""


def load_structure(package: Package, stack: contextlib.ExitStack) -> Structure:
    """Return the structure of a package, with FMUs as its only components and values in its bindings.

    The source of a component is the path of its file. Nested packages stay open as long as `stack`.

    Args:
        package: The package.
        stack: Closes nested packages.

    Raises:
        CommandError: If something is missing, not supported, or contains itself.
    """
    return _Loader(package, stack, (), itertools.count(1)).structure()


class _Loader:
    """Loads one SSD.

    `outer_files` lists the outer SSD files, with ids within them. `count` numbers the components of the whole
    structure.
    """

    def __init__(
        self,
        package: Package,
        stack: contextlib.ExitStack,
        outer_files: tuple[str, ...],
        count: Iterator[int],
    ) -> None:
        self._package, self._stack, self._outer_files, self._count = package, stack, outer_files, count
        self._where = package.name
        self._by_id: dict[str, SystemElement] = {}

    def _make_fault(self, text: str) -> CommandError:
        return CommandError(f"'{self._where}': {text}")

    def structure(self) -> Structure:
        """Return the structure with its files."""
        parsed_ssd = self._parse_ssd()
        return replace(parsed_ssd, system=self._load_system(parsed_ssd.system))

    def _parse_ssd(self) -> Structure:
        """Return the structure of the SSD without its files, and store its systems by id."""
        structure = parse_structure(_read_bytes(self._package.ssd), self._where)
        self._by_id = {s.id: s for s in _list_systems(structure.system) if s.id is not None}
        return structure

    def _load_system(self, system: SystemElement) -> SystemElement:
        return replace(
            system,
            bindings=tuple(self._load_binding(b, None) for b in system.bindings),
            elements=tuple(self._load_element(e) for e in system.elements),
        )

    def _load_element(self, element: Element) -> Element:
        """Return an element with its files: an FMU, or the system to which it refers."""
        if isinstance(element, SystemElement):
            return self._load_system(element)
        if not isinstance(element, ComponentElement):
            return element
        if next(self._count) > _MOST_COMPONENTS:
            raise self._make_fault(f"the structure has more than {_MOST_COMPONENTS} components.")
        match element.type:
            case _ if element.source.startswith("#"):
                return self._load_same_document(element)
            case t if t == FMU:
                return self._load_fmu(element)
            case t if t in (SSD, SSP):
                return self._load_other_document(element)
            case other:
                raise self._make_fault(
                    f"the component '{element.name}' is of type '{other}'; this master supports FMUs and "
                    "systems."
                )

    def _load_fmu(self, component: ComponentElement) -> ComponentElement:
        """Return a component with the path of its FMU and the content of its bindings."""
        if not component.source:
            raise self._make_fault(f"the component '{component.name}' has no source.")
        if component.implementation not in ("any", *KINDS.values()):
            raise self._make_fault(
                f"the component '{component.name}' requires {component.implementation}; this "
                f"master supports {join_names(KINDS.values())}."
            )
        fmu = self._package.file(component.source, self._where)
        return replace(
            component, source=str(fmu), bindings=tuple(self._load_binding(b, fmu) for b in component.bindings)
        )

    def _load_same_document(self, component: ComponentElement) -> SystemElement:
        """Return the system in this SSD to which a component refers by id."""
        inner = self._make_inner_loader(f"{self._package.ssd.resolve()}{component.source}", component)
        # it is in the same file, so ids and error messages are the same
        inner._where, inner._by_id = self._where, self._by_id
        return self._insert_system(
            component, inner._load_system(self._find_by_id(component.source[1:], component))
        )

    def _find_by_id(self, id_: str, component: ComponentElement) -> SystemElement:
        system = self._by_id.get(unquote(id_))
        if system is None:
            raise self._make_fault(
                f"the component '{component.name}' refers to '{component.source}', but no system has this id."
            )
        return system

    def _load_other_document(self, component: ComponentElement) -> SystemElement:
        """Return the system in another SSD or package to which a component refers."""
        uri, _, fragment = component.source.partition("#")
        file = self._package.file(uri, self._where)
        inner = self._make_inner_loader(f"{file}#{fragment}", component)
        inner._where = f"{self._where}/{component.source}"
        if component.type == SSP:
            inner._package = self._stack.enter_context(open_package(file, unquote(fragment)))
            return self._insert_system(component, inner.structure().system)
        inner._package = replace(self._package, ssd=file, name=inner._where)
        root = inner._parse_ssd().system
        return self._insert_system(
            component, inner._load_system(inner._find_by_id(fragment, component) if fragment else root)
        )

    def _make_inner_loader(self, file: str, component: ComponentElement) -> "_Loader":
        """Return a loader for the system of a component. Raise CommandError if it would contain itself."""
        outer_files = self._outer_files or (f"{self._package.ssd.resolve()}#",)
        if file in outer_files:
            raise self._make_fault(
                f"the component '{component.name}' refers to '{component.source}', which contains it."
            )
        if len(outer_files) > _DEEPEST:
            raise self._make_fault(
                f"the component '{component.name}' is nested more than {_DEEPEST} levels deep."
            )
        return _Loader(self._package, self._stack, (*outer_files, file), self._count)

    def _insert_system(self, component: ComponentElement, system: SystemElement) -> SystemElement:
        """Return a system under the name of the component that refers to it, with its bindings last."""
        bindings = tuple(self._load_binding(b, None) for b in component.bindings)
        connectors = {c.name: c for c in system.connectors}
        for connector in component.connectors:
            inside = connectors.get(connector.name)
            connectors[connector.name] = self._join_connectors(connector, inside, component)
        return replace(
            system,
            name=component.name,
            id=component.id,
            bindings=(*system.bindings, *bindings),  # the last of two values applies
            connectors=tuple(connectors.values()),
        )

    def _join_connectors(
        self, outside: Connector, inside: Connector | None, component: ComponentElement
    ) -> Connector:
        """Return the connector of a component and its system; raise CommandError if they differ."""
        name = f"the connector '{outside.name}' of the component '{component.name}'"
        if inside is None:
            raise self._make_fault(f"{name} is not one of '{component.source}'.")
        if outside.kind != inside.kind:
            raise self._make_fault(
                f"{name} is of kind {outside.kind}, in '{component.source}' {inside.kind}."
            )
        if outside.unit is None or inside.unit is None:  # one of the documents may leave it out
            return replace(inside, unit=inside.unit or outside.unit)
        if not outside.unit.measures_as(inside.unit):
            raise self._make_fault(f"{name} is in {outside.unit}, in '{component.source}' in {inside.unit}.")
        return inside

    def _load_binding(self, binding: ParameterBinding, fmu: Path | None) -> ParameterBinding:
        """Return a binding with the content of its files; `fmu` is the FMU whose files it may name."""
        values, mapping = binding.values, binding.mapping
        if isinstance(values, FileReference):
            values = parse_parameter_set(*self._read_reference(values, fmu))
        if isinstance(mapping, FileReference):
            mapping = parse_mapping(*self._read_reference(mapping, fmu))
        return replace(binding, values=values, mapping=mapping)

    def _read_reference(self, reference: FileReference, fmu: Path | None) -> tuple[bytes, str]:
        """Return content and name of a file."""
        if reference.base == "component" and fmu is not None:
            content = read_inside_fmu(fmu, reference.source, self._where)
            return content, f"{fmu.name}/{reference.source}"
        return _read_bytes(self._package.file(reference.source, self._where)), reference.source


def _list_systems(system: SystemElement) -> Iterator[SystemElement]:
    yield system
    for element in system.elements:
        if isinstance(element, SystemElement):
            yield from _list_systems(element)


def _read_bytes(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise CommandError(f"'{path.name}' cannot be read: {error.strerror}.") from error
