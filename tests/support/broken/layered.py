"""FMUs of FMI 3.0 whose manifest of a layered standard is wrong in one thing."""

from collections.abc import Mapping

from fmu_verify.check import Verdict
from tests.support.broken.broken import Broken
from tests.support.broken.editing import DESCRIPTION, Build, Files, with_files

_TERMINALS = "terminalsAndIcons/terminalsAndIcons.xml"
_EXTRA = "extra/org.fmi-standard.fmi-ls-"
_MAP = "org.fmi-standard.fmi-ls-struct.map"

_CONTENT = {
    "ref": '<Related type="text/csv" source="data/run%20one.csv" role="result"><Label name="all"/></Related>'
    '<Related source="../../documentation/index.html" role="document"/>'
    '<Related source="https://example.com/requirements" role="requirement"/>',
    "bus": "",
    "xcp": '<Interface definition="ecu.a2l" containsXCPService="true" types="CoSimulation">'
    '<Variable name="damped" role="XCPServiceTCPEnable"/></Interface>',
    "struct": "",
}
_FILES = {"ref": {"data/run one.csv": b"time\n0\n"}, "xcp": {"x86_64-linux/ecu.a2l": b"ASAP2_VERSION 1 71"}}


def write_terminal(kind: str, rule: str, members: Mapping[str, tuple[str, str]]) -> str:
    """Return a terminal; `members` are the variable and the variableKind by name of the member."""
    parts = "".join(
        f'<TerminalMemberVariable variableName="{variable}" memberName="{name}" variableKind="{of}"/>'
        for name, (variable, of) in members.items()
    )
    return f'<Terminal name="t" matchingRule="{rule}" terminalKind="{kind}">{parts}</Terminal>'


_MEMBERS = {"k": ("spring.k", f"{_MAP}.domain"), "v": ("v", f"{_MAP}.codomain")}
_TERMINAL = {
    "bus": write_terminal("org.fmi-ls-bus.network-terminal", "bus", {}),
    "struct": write_terminal(f"{_MAP}.irregular", _MAP, _MEMBERS),
}


def write_manifest(name: str, content: str = "") -> str:
    """Return a manifest of a layered standard of the FMI project, by the end of its name: `ref`."""
    root = "fmiReferences" if name == "ref" else "fmiLayeredStandardManifest"
    return (
        f'<{root} xmlns:fmi-ls="http://fmi-standard.org/fmi-ls-manifest" '
        f'fmi-ls:fmi-ls-name="org.fmi-standard.fmi-ls-{name}" fmi-ls:fmi-ls-version="1.0.0" '
        f'fmi-ls:fmi-ls-description="A layered standard">{content}</{root}>'
    )


def with_manifest(
    name: str,
    changes: Mapping[str, str] | None = None,
    terminal: str = "",
    variables: str = "",
    more: Mapping[str, bytes] | None = None,
) -> Build:
    """Builds the toy with a valid manifest, its files and terminals, and texts in place of others.

    Args:
        name: End of the name of the layered standard: `ref`, `bus`, `xcp` or `struct`.
        changes: New texts by old ones, each of which has to be in the manifest or the terminal.
        terminal: The terminal; default: a valid one.
        variables: Further variables, which the library of the toy does not have.
        more: Further files by path.
    """
    manifest = write_manifest(name, _CONTENT[name])
    terminal = terminal or _TERMINAL.get(name, "")
    for old, new in (changes or {}).items():
        assert old in manifest + terminal, f"{old} is not there"
        manifest, terminal = manifest.replace(old, new), terminal.replace(old, new)

    def edit(files: Files) -> None:
        end = "</GraphicalRepresentation>"
        terminals = f"{end}<Terminals>{terminal}</Terminals>" if terminal else end
        files[_TERMINALS] = files[_TERMINALS].replace(end.encode(), terminals.encode())
        end = "</ModelVariables>"
        files[DESCRIPTION] = files[DESCRIPTION].replace(end.encode(), f"{variables}{end}".encode())
        files[f"{_EXTRA}{name}/fmi-ls-manifest.xml"] = manifest.encode()
        files.update({f"{_EXTRA}{name}/{file}": content for file, content in _FILES.get(name, {}).items()})
        files.update(more or {})

    return with_files(edit, fmi=3)


def _layered(name: str, what: str, build: Build, verdict: Verdict = Verdict.FAILED) -> Broken:
    return Broken(f"layered-{name}", what, "layered.manifests", build, verdict=verdict)


# fmt: off
LAYERED: list[Broken] = [
    _layered("ill-formed", "a manifest of a layered standard that is no XML",
        with_manifest("ref", {"</fmiReferences>": ""})),
    _layered("no-version", "a manifest of FMI-LS-REF without its version",
        with_manifest("ref", {'fmi-ls:fmi-ls-version="1.0.0"': ""})),
    _layered("other-name", "a manifest in the folder of another layered standard",
        with_manifest("ref", {'fmi-ls-ref"': 'fmi-ls-xcp"'})),
    _layered("no-namespace", "a name of a layered standard that is not in the namespace of manifests",
        with_manifest("xcp", {"fmi-ls:fmi-ls-name": "fmi-ls-name"})),
    _layered("role", "a related file with a role that does not exist",
        with_manifest("ref", {'role="result"': 'role="results"'})),
    _layered("outside", "a related file that is outside of the FMU",
        with_manifest("ref", {"data/run%20one.csv": "../../../run.csv"})),
    _layered("related", "a related file that does not exist",
        with_manifest("ref", {"data/run%20one.csv": "data/run.csv"}), Verdict.WARNING),
    _layered("a2l", "an A2L file that does not exist", with_manifest("xcp", {"ecu.a2l": "other.a2l"})),
    _layered("service", "an XCP interface without a service and without access to memory",
        with_manifest("xcp", {' containsXCPService="true"': ""})),
    _layered("xcp-variable", "an XCP role of a variable that does not exist",
        with_manifest("xcp", {'"damped"': '"damping"'})),
    _layered("xcp-type", "an XCP port that is a Boolean",
        with_manifest("xcp", {"XCPServiceTCPEnable": "XCPServiceTCPPort"})),
    _layered("no-network", "a manifest of FMI-LS-BUS without a terminal of a network",
        with_manifest("bus", {"org.fmi-ls-bus.network-terminal": "org.example.network"})),
    _layered("no-members", "a bus terminal without its data and Clocks",
        with_manifest("bus", {'matchingRule="bus"': 'matchingRule="org.fmi-ls-bus.transceiver"'})),
    _layered("bus-flag", "isBusSimulationFMU is neither true nor false",
        with_manifest("bus", {"Manifest xmlns": 'Manifest isBusSimulationFMU="no" xmlns'})),
    _layered("map-size", "a map with points that have no value",
        with_manifest("struct", {'variableName="v"': 'variableName="x"'})),
    _layered("map-kind", "a member of a map with a variableKind that does not exist",
        with_manifest("struct", {f'{_MAP}.codomain"': f'{_MAP}.range"'})),
    _layered("a2l-include", "an A2L file that includes another one",
        with_manifest("xcp", more={f"{_EXTRA}xcp/x86_64-linux/ecu.a2l": b'/include "other.a2l"'})),
    _layered("version", "a version of a layered standard that is not semantic",
        with_manifest("ref", {"1.0.0": "one"}), Verdict.WARNING),
    _layered("map-values", "a map without values",
        with_manifest("struct", {f'{_MAP}.codomain"': 'org.example.values"'})),
    _layered("map-rule", "a map with the matching rule of buses",
        with_manifest("struct", {f'matchingRule="{_MAP}"': 'matchingRule="bus"'}), Verdict.WARNING),
    _layered("no-reverse-domain", "a folder in `extra` whose name is not in reverse domain notation",
        with_manifest("ref", more={"extra/mytool/notes.txt": b"!"}), verdict=Verdict.PASSED),
]
# fmt: on
