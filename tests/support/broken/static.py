"""FMUs that are wrong in one thing that can be seen without running them."""

import re
import zipfile
from collections.abc import Callable
from pathlib import Path

import fmpy

from fmu_verify.check import Verdict
from tests.support.broken.broken import Broken
from tests.support.broken.editing import (
    DESCRIPTION,
    Build,
    Edit,
    Files,
    append,
    good_bytes,
    good_files,
    set_attributes,
    setting,
    with_files,
    with_text,
    with_tree,
    without,
    written,
)

LIBRARY = f"binaries/{fmpy.platform}/Toy{fmpy.sharedLibraryExtension}"
_ELSEWHERE = f"binaries/{'linux64' if fmpy.platform == 'win64' else 'win64'}/Toy{Path(LIBRARY).suffix}"


def _entries(name: str | zipfile.ZipInfo, content: bytes) -> Build:
    """Builds the good FMU with one more entry in its archive."""
    return lambda folder: written(folder / "Toy.fmu", [*good_files().items(), (name, content)])


def _link() -> zipfile.ZipInfo:
    entry = zipfile.ZipInfo("resources/secret")
    entry.external_attr = 0o120777 << 16
    return entry


def _bytes(edit: Callable[[bytes], bytes]) -> Build:
    """Builds the good FMU with the bytes of its archive changed."""

    def build(folder: Path) -> Path:
        (path := folder / "Toy.fmu").write_bytes(edit(good_bytes()))
        return path

    return build


def _bomb(folder: Path) -> Path:
    """300 MiB of zeros, a MiB at a time."""
    path = written(folder / "Toy.fmu", good_files().items())
    with (
        zipfile.ZipFile(path, "a", zipfile.ZIP_DEFLATED) as archive,
        archive.open("resources/zeros", "w") as stream,
    ):
        for _ in range(300):
            stream.write(bytes(2**20))
    return path


def _bzip2(folder: Path) -> Path:
    path = written(folder / "Toy.fmu", good_files().items())
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("documentation/more.html", b"<p>More" * 99, zipfile.ZIP_BZIP2)
    return path


def _other_library(files: Files) -> None:
    """A library of another name, and no sources."""
    files[f"{Path(LIBRARY).parent}/Other{Path(LIBRARY).suffix}"] = files.pop(LIBRARY)
    files[DESCRIPTION] = re.sub(b"<SourceFiles>.*?</SourceFiles>", b"", files[DESCRIPTION], flags=re.DOTALL)
    for name in [n for n in files if n.startswith("sources/")]:
        del files[name]


def _renamed(files: Files) -> None:
    """A model identifier that is no name of the language C, also of the library."""
    files[str(Path(LIBRARY).with_stem("Toy-1"))] = files.pop(LIBRARY)
    files[DESCRIPTION] = files[DESCRIPTION].replace(b'modelIdentifier="Toy"', b'modelIdentifier="Toy-1"')


def _in_latin_1(files: Files) -> None:
    text = files[DESCRIPTION].decode().replace('encoding="UTF-8"', 'encoding="ISO-8859-1"')
    files[DESCRIPTION] = text.encode("latin-1")


def _with_library(edit: Callable[[bytes], bytes]) -> Build:
    return with_files(lambda files: files.update({LIBRARY: edit(files[LIBRARY])}))


def _rename_entries(old: str, new: str) -> Build:
    """Builds the good FMU with a file, or all files of a folder, in another place."""

    def edit(files: Files) -> None:
        names = [name for name in files if name == old or name.startswith(f"{old}/")]
        assert names, f"{old} is not there"
        for name in names:
            files[f"{new}{name.removeprefix(old)}"] = files.pop(name)

    return with_files(edit)


def _another_library(path: str, processor: int) -> Build:
    """Builds the good FMU with the header of a Windows library for a processor, by its number."""
    start = b"MZ".ljust(60, b"\0") + (64).to_bytes(4, "little") + b"PE\0\0"
    content = start + processor.to_bytes(2, "little")
    return with_files(lambda files: files.update({f"binaries/{path}": content}))


def _output(name: str, reference: int, variability: str, index: int) -> tuple[Edit, ...]:
    """Append a Real output to the variables and lists."""
    return (
        append(
            "ModelVariables",
            f'<ScalarVariable name="{name}" valueReference="{reference}" causality="output" '
            f'variability="{variability}"><Real/></ScalarVariable>',
        ),
        append("ModelStructure/Outputs", f'<Unknown index="{index}"/>'),
        append("ModelStructure/InitialUnknowns", f'<Unknown index="{index}"/>'),
    )


def _variable(name: str) -> str:
    return f"//ScalarVariable[@name='{name}']"


_DTD = '<!DOCTYPE fmiModelDescription [<!ENTITY lol "lol">]>\n<fmiModelDescription'

# fmt: off
STATIC: list[Broken] = [
    Broken("traversal", "An entry that leads out of the archive", "archive.safe",
        _entries("../evil", b"!")),
    Broken("link", "A link among the entries", "archive.safe", _entries(_link(), b"/etc/passwd")),
    Broken("bomb", "A zip bomb", "archive.safe", _bomb),
    Broken("cut-archive", "An archive that is cut off", "archive.safe",
        _bytes(lambda content: content[: len(content) // 2])),
    # in the first entry, which is compressed
    Broken("corrupt-archive", "A wrong byte in the archive", "archive.safe",
        _bytes(lambda content: content[:2000] + bytes([content[2000] ^ 0xFF]) + content[2001:])),
    Broken("twice", "Two entries of one name", "archive.safe", _entries(DESCRIPTION, b"<other/>")),
    Broken("bzip2", "An entry that is compressed with bzip2", "archive.format", _bzip2),
    Broken("no-description", "No modelDescription.xml", "description.readable",
        with_files(lambda files: files.pop(DESCRIPTION))),
    Broken("ill-formed", "A model description that is no XML", "description.readable",
        with_text("</ModelVariables>", "")),
    Broken("fmi-1", "A model description of FMI 1.0", "description.readable",
        with_text('fmiVersion="2.0"', 'fmiVersion="1.0"')),
    Broken("dtd", "A document type definition with entities", "description.readable",
        with_text("<fmiModelDescription", _DTD)),
    Broken("latin-1", "A model description in Latin 1", "description.encoding", with_files(_in_latin_1)),
    Broken("unknown-attribute", "An attribute that the schema does not know", "description.schema",
        setting("/fmiModelDescription", colour="blue")),
    Broken("no-c-name", "A model identifier that is no name in C", "description.identifier",
        with_files(_renamed)),
    Broken("serializes-nothing", "`canSerializeFMUstate` without `canGetAndSetFMUstate`",
        "description.capabilities",
        setting("//CoSimulation | //ModelExchange", canGetAndSetFMUstate="false")),
    Broken("category-twice", "Two log categories of one name", "description.categories",
        with_tree(append("LogCategories", '<Category name="logStatusError"/>'))),
    Broken("no-type", "A declared type that is not defined", "description.types",
        setting(f"{_variable('x')}/Real", declaredType="Distance")),
    Broken("no-unit", "A unit that is not defined", "units.defined", without("//Unit[@name='W']")),
    Broken("wrong-exponents", "The unit N/m with the exponents of N", "units.consistent",
        setting("//Unit[@name='N/m']/BaseUnit", m="1"), verdict=Verdict.WARNING),
    Broken("wrong-letter", "The unit W with the exponents of A", "units.consistent",
        setting("//Unit[@name='W']/BaseUnit", kg=None, m=None, s=None, A="1"), verdict=Verdict.WARNING),
    Broken("wrong-factor", "The display unit mm with the factor 1", "units.consistent",
        setting("//DisplayUnit[@name='mm']", factor="1"), verdict=Verdict.WARNING),
    Broken("infinite-factor", "A unit with an infinite factor", "units.consistent",
        setting("//Unit[@name='N/m']/BaseUnit", factor="INF")),
    Broken("unit-of-derivative", "`der(x)` in the unit of `x`", "units.derivatives",
        setting(f"{_variable('der(x)')}/Real", unit="m", displayUnit=None, declaredType=None)),
    Broken("name-twice", "Two variables of one name", "variables.names",
        setting(_variable("step_count"), name="random")),
    Broken("unstructured", "A name that is not structured, where names are said to be", "variables.names",
        setting(_variable("step_count"), name="steps so far")),
    Broken("fixed-output", "An output that is fixed", "variables.attributes",
        setting(_variable("power"), variability="fixed")),
    Broken("continuous-integer", "An Integer without variability, which makes it continuous",
        "variables.attributes", setting(_variable("count"), causality="local", variability=None)),
    Broken("no-start", "An input without a start value", "variables.start",
        setting(f"{_variable('force')}/Real", start=None)),
    Broken("start-of-calculated", "A calculated output with a start value", "variables.start",
        setting(f"{_variable('power')}/Real", start="1")),
    Broken("beyond-max", "A start value above its max", "variables.range",
        setting(f"{_variable('body.mass')}/Real", max="1.0")),
    Broken("nan-start", "A start value that is NaN", "variables.range",
        setting(f"{_variable('x_0')}/Real", start="NaN")),
    Broken("one-reference", "Two parameters of one value reference", "variables.aliases",
        setting(_variable("count"), valueReference="7")),
    Broken("output-not-listed", "An output that ModelStructure/Outputs lacks", "structure.outputs",
        without("//Outputs/Unknown[@index='17']")),
    Broken("derivative-of-nothing", "A derivative of a variable that is not there", "structure.derivatives",
        setting(f"{_variable('der(x)')}/Real", derivative="99")),
    Broken("unknowns-disordered", "InitialUnknowns that are not in order", "structure.initial_unknowns",
        with_tree(lambda root: root.find("*/InitialUnknowns").append(root.find("*/InitialUnknowns")[0]))),
    Broken("unknown-not-listed", "An initial unknown that is not listed", "structure.initial_unknowns",
        without("//InitialUnknowns/Unknown[@index='16']")),
    Broken("depends-on-nothing", "A dependency on a variable that is not there", "structure.dependencies",
        setting("//Outputs/Unknown[@index='16']", dependencies="1 12 4294967295")),
    Broken("kinds-missing", "Fewer kinds than dependencies", "structure.dependencies",
        setting("//Outputs/Unknown[@index='16']", dependenciesKind="dependent")),
    Broken("no-binary", "No library of the model's name, and no sources", "binaries.present",
        with_files(_other_library)),
    Broken("missing-symbol", "A function that the library does not export", "binaries.symbols",
        _with_library(lambda content: content.replace(b"fmi2GetStringStatus\0", b"fmi2GetStringStatuz\0"))),
    Broken("other-platform", "A library for this platform in the folder of another one", "binaries.platform",
        with_files(lambda files: files.update({_ELSEWHERE: files[LIBRARY]}))),
    Broken("no-library", "A library that is text", "binaries.symbols",
        _with_library(lambda _: b"Not Found\n" * 99)),
    Broken("cut-library", "A library that is cut off", "binaries.loads",
        _with_library(lambda content: content[: len(content) // 3])),
    Broken("no-header", "A header that the sources lack", "sources.compile",
        with_files(lambda files: files.pop("sources/equations.h"))),
    Broken("folder-case", "A folder of the archive in the wrong case", "archive.layout",
        _rename_entries("documentation", "Documentation")),
    Broken("folder-name", "A folder of the archive with a similar name", "archive.layout",
        _rename_entries("terminalsAndIcons", "terminalsAndIcon"), verdict=Verdict.WARNING),
    Broken("file-case", "A file of the standard in the wrong case", "archive.layout",
        _rename_entries("documentation/index.html", "documentation/Index.html")),
    Broken("description-case", "The model description in the wrong case", "description.readable",
        _rename_entries(DESCRIPTION, "ModelDescription.xml")),
    Broken("in-folder", "All files in a folder of the archive", "description.readable",
        with_files(lambda files: [files.update({f"Toy/{name}": files.pop(name)}) for name in [*files]])),
    Broken("platform-case", "The folder of a platform in the wrong case", "binaries.platform",
        _rename_entries(str(Path(LIBRARY).parent), f"binaries/{fmpy.platform.capitalize()}")),
    Broken("platform-name", "The folder of a platform with another name for it", "binaries.platform",
        _rename_entries(str(Path(LIBRARY).parent), f"binaries/{fmpy.platform[:-2]}_{fmpy.platform[-2:]}"),
        verdict=Verdict.WARNING),
    Broken("library-case", "The library in the wrong case", "binaries.present",
        _rename_entries(LIBRARY, LIBRARY.replace("Toy", "toy"))),
    Broken("library-prefix", "The library with the prefix lib", "binaries.present",
        _rename_entries(LIBRARY, LIBRARY.replace("Toy", "libToy"))),
    Broken("library-suffix", "A library of Windows with the suffix of Linux", "binaries.present",
        _another_library("win32/Toy.so", 0x014C)),
    Broken("32-bits", "A library for 32 bits in the folder for 64 bits", "binaries.platform",
        _another_library("win64/Toy.dll", 0x014C)),
    Broken("arm", "A library for ARM in the folder for x86", "binaries.platform",
        _another_library("win64/Toy.dll", 0xAA64)),
    Broken("alias-variability", "Two outputs with one value reference, of which one is discrete",
        "variables.aliases",
        with_tree(*_output("a", 97, "continuous", 21), *_output("b", 97, "discrete", 22)),
        verdict=Verdict.WARNING),
    Broken("alias-dependency", "An output that is an alias of a state, but does not depend on it",
        "structure.dependencies",
        with_tree(*_output("a", 11, "continuous", 21),
            set_attributes("//Unknown[@index='21']", dependencies="1"),
            set_attributes(f"{_variable('a')}/Real", unit="m/s"))),
    Broken("state-not-listed", "A state whose derivative ModelStructure does not list",
        "structure.derivatives", without("//Derivatives/Unknown[@index='20']"), verdict=Verdict.WARNING),
    Broken("discrete-derivative", "A state derivative that is discrete", "structure.derivatives",
        setting(_variable("der(x)"), variability="discrete")),
    Broken("state-dependency", "A state derivative that depends on a state at the start only",
        "structure.dependencies", setting("//Derivatives/Unknown[@index='18']", dependencies=""),
        verdict=Verdict.WARNING),
    Broken("reinit", "An output with reinit that is not a state", "variables.attributes",
        setting(f"{_variable('power')}/Real", reinit="true")),
    Broken("initial-kind", "A factor that is fixed after initialization, in initialization",
        "structure.dependencies",
        setting("//InitialUnknowns/Unknown[@index='18']", dependenciesKind="fixed")),
    Broken("two-identifiers", "A library for Model Exchange that is missing beside the other",
        "binaries.present", setting("//ModelExchange", modelIdentifier="Toy2"), verdict=Verdict.WARNING),
    Broken("terminal", "A terminal with a variable that does not exist", "description.terminals",
        with_text("</GraphicalRepresentation>",
            '</GraphicalRepresentation><Terminals><Terminal name="t" matchingRule="bus">'
            '<TerminalMemberVariable variableName="nothing" memberName="a" variableKind="signal"/>'
            "</Terminal></Terminals>", file="terminalsAndIcons/terminalsAndIcons.xml")),
    Broken("set-once", "A parameter that can be set once at a time, which is for inputs",
        "variables.attributes",
        setting(_variable("body.mass"), canHandleMultipleSetPerTimeInstant="false")),
    Broken("patch-version", "The patch number of FMI in the version", "description.readable",
        with_text('fmiVersion="2.0"', 'fmiVersion="2.0.4"')),
    Broken("empty-platform", "An empty folder of a platform", "binaries.present",
        _entries("binaries/darwin64/", b""), verdict=Verdict.WARNING),
    Broken("no-function", "Sources without a function that the header files of FMI declare",
        "sources.compile",
        with_text("fmi2GetStringStatus(", "get_string_status(", file="sources/fmi2_status.h")),
    Broken("no-source", "A source file that is listed, but not there", "sources.compile",
        setting("//SourceFiles/File", name="elsewhere.c")),
]
# fmt: on
