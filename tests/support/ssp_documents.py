"""SSPs and FMUs in a few words: the text of their parts, and how they are understood.

Variables and connectors are written `name:causality`, then a type, a unit of `UNITS` or, for variables,
`exact` for an output with a start value and `relative` for a difference: "u:input:mm",
"n:parameter:Integer".
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

from emla_cosim.fmu.interface import read_interface
from emla_cosim.ssp.reader.flat_document import read_ssp
from emla_cosim.system.model import System
from emla_cosim.system.resolution import resolve_system
from fmublock.archive import write_archive

UNITS = {
    "m": 'm="1"',
    "mm": 'm="1" factor="0.001"',
    "km": 'm="1" factor="1000"',
    "K": 'K="1"',
    "degC": 'K="1" offset="273.15"',
    "degF": 'K="1" factor="0.5555555555555556" offset="255.3722222222222"',
    "rad/s": 's="-1" rad="1"',
    "rpm": 's="-1" rad="1" factor="0.10471975511965977"',
}
TYPES = ("Real", "Integer", "Boolean", "String", "Enumeration", "Float64", "Int32")
ITEMS = {"off": 1, "slow": 2, "fast": 5}
"""The enumeration of all variables of this type."""

_ROOT = "http://ssp-standard.org/SSP1/SystemStructure"
NAMESPACES = " ".join(
    f'xmlns:{prefix}="{_ROOT}{name}"'
    for prefix, name in (
        ("ssd", "Description"),
        ("ssc", "Common"),
        ("ssv", "ParameterValues"),
        ("ssm", "ParameterMapping"),
        ("ssb", "SignalDictionary"),
    )
)
_STARTS = {"Real": "0", "Integer": "0", "Boolean": "false", "String": "", "Enumeration": "1"}


def attributes(**values: object) -> str:
    """Attributes of an element; those that are None are left out, `start_time` becomes startTime."""
    texts = []
    for name, value in values.items():
        if value is not None:
            head, *rest = name.rstrip("_").split("_")
            text = str(value).lower() if isinstance(value, bool) else str(value)
            texts.append(f" {head}{''.join(r.title() for r in rest)}={quoteattr(text)}")
    return "".join(texts)


# ---- FMUs --------------------------------------------------------------------------------------


def fake_fmu(path: Path, *variables: str, units: Mapping[str, str] = UNITS) -> Path:
    """An FMU that has a model description and nothing else."""
    write_archive(path, {"modelDescription.xml": description(path.stem, *variables, units=units).encode()})
    return path


def description(name: str, *variables: str, units: Mapping[str, str] = UNITS) -> str:
    """A model description with these variables."""
    texts = [_variable(i, *text.split(":")) for i, text in enumerate(variables)]
    outputs = [i for i, text in enumerate(variables, 1) if text.split(":")[1] == "output"]
    unknowns = "".join(f'<Unknown index="{i}"/>' for i in outputs)
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="{name}" guid="{name}">
  <CoSimulation modelIdentifier="{name}"/>
  {_units("UnitDefinitions", "", units)}
  <TypeDefinitions><SimpleType name="Mode"><Enumeration>
    {"".join(f'<Item name="{item}" value="{value}"/>' for item, value in ITEMS.items())}
  </Enumeration></SimpleType></TypeDefinitions>
  <ModelVariables>{"".join(texts)}</ModelVariables>
  <ModelStructure>
    {f"<Outputs>{unknowns}</Outputs>" if outputs else ""}
    {f"<InitialUnknowns>{unknowns}</InitialUnknowns>" if outputs else ""}
  </ModelStructure>
</fmiModelDescription>"""


def _variable(reference: int, name: str, causality: str, *more: str) -> str:
    type_ = next((m for m in more if m in TYPES), "Real")
    unit = next((m for m in more if m not in (*TYPES, "exact", "relative")), None)
    relative = True if "relative" in more else None
    initial = "exact" if "exact" in more or causality == "parameter" else None
    start = _STARTS[type_] if initial or causality == "input" else None
    variability = {"parameter": "fixed"}.get(causality, "continuous" if type_ == "Real" else "discrete")
    declared = "Mode" if type_ == "Enumeration" else None
    head = attributes(
        name=name, value_reference=reference, causality=causality, variability=variability, initial=initial
    )
    inside = attributes(declared_type=declared, unit=unit, relative_quantity=relative, start=start)
    return f"<ScalarVariable{head}><{type_}{inside}/></ScalarVariable>"


def _units(tag: str, prefix: str, units: Mapping[str, str]) -> str:
    texts = [
        f"<{prefix}Unit{attributes(name=name)}>{f'<{prefix}BaseUnit {base}/>' if base else ''}</{prefix}Unit>"
        for name, base in units.items()
    ]
    return f"<{tag}>{''.join(texts)}</{tag}>" if texts else ""


# ---- SSD ---------------------------------------------------------------------------------------


def ssd(
    root: str, version: str = "1.0", experiment: str = "", units: Mapping[str, str] = UNITS, more: str = ""
) -> str:
    """A structure description with this root system."""
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<ssd:SystemStructureDescription {NAMESPACES} version="{version}" name="test">{root}
{_units("ssd:Units", "ssc:", units)}{experiment}{more}
</ssd:SystemStructureDescription>"""


def system(name: str, *parts: str, ports: str = "", bindings: str = "", **more: object) -> str:
    """A system; its parts are elements and connections, and signal dictionaries behind them."""
    connections = [p for p in parts if p.startswith("<ssd:Connection ")]
    dictionaries = [p for p in parts if p.startswith("<ssd:SignalDictionary ")]
    elements = [p for p in parts if p not in connections and p not in dictionaries]
    return (
        f"<ssd:System{attributes(name=name, **more)}>{connectors(ports)}{_bindings(bindings)}"
        f"{_group('Elements', elements)}{_group('Connections', connections)}"
        f"{_group('SignalDictionaries', dictionaries)}</ssd:System>"
    )


def component(name: str, source: str | None, ports: str = "", bindings: str = "", **more: object) -> str:
    """A component: connectors with spaces between, bindings one after the other."""
    inside = f"{connectors(ports)}{_bindings(bindings)}"
    return f"<ssd:Component{attributes(name=name, source=source, **more)}>{inside}</ssd:Component>"


def _group(tag: str, parts: list[str]) -> str:
    return f"<ssd:{tag}>{''.join(parts)}</ssd:{tag}>" if parts else ""


def _bindings(text: str) -> str:
    return _group("ParameterBindings", [text] if text else [])


def connectors(ports: str) -> str:
    """Connectors of an element; without type and unit they have none."""
    texts = []
    for name, kind, *more in (port.split(":") for port in ports.split()):
        type_ = next((m for m in more if m in TYPES), "Real")
        unit = next((m for m in more if m not in TYPES), None)
        inside = f"<ssc:{type_}{attributes(unit=unit)}/>" if more else ""
        texts.append(f"<ssd:Connector{attributes(name=name, kind=kind)}>{inside}</ssd:Connector>")
    return _group("Connectors", texts)


def connection(wire: str, inside: str = "", **more: object) -> str:
    """A connection written `a.y -> b.u`; a connector of the system itself has no element."""
    (start, y), (end, u) = (_end(text) for text in wire.split(" -> "))
    ends = attributes(start_element=start, start_connector=y, end_element=end, end_connector=u)
    return f"<ssd:Connection{ends}{attributes(**more)}>{inside}</ssd:Connection>"


def _end(text: str) -> tuple[str | None, str]:
    element, dot, name = text.partition(".")
    return (element, name) if dot else (None, text)


def linear(factor: float | str | None = None, offset: float | str | None = None) -> str:
    """A linear transformation."""
    return f"<ssc:LinearTransformation{attributes(factor=factor, offset=offset)}/>"


def table(kind: str, **entries: object) -> str:
    """A mapping table of a kind: Boolean, Integer (with keys like `_3`) or Enumeration."""
    texts = [f"<ssc:MapEntry{attributes(source=s.removeprefix('_'), target=t)}/>" for s, t in entries.items()]
    return f"<ssc:{kind}MappingTransformation>{''.join(texts)}</ssc:{kind}MappingTransformation>"


# ---- parameters --------------------------------------------------------------------------------


def binding(values: str, mapping: str = "", **more: object) -> str:
    """A binding to a file, or to the parameter set itself; so is the mapping."""
    source = None if values.startswith("<") else values
    inside = "" if source else f"<ssd:ParameterValues>{_without_head(values)}</ssd:ParameterValues>"
    if mapping.startswith("<"):
        inside += f"<ssd:ParameterMapping>{_without_head(mapping)}</ssd:ParameterMapping>"
    elif mapping:
        base = attributes(source_base=more.get("source_base"))
        inside += f"<ssd:ParameterMapping{attributes(source=mapping)}{base}/>"
    return f"<ssd:ParameterBinding{attributes(source=source, **more)}>{inside}</ssd:ParameterBinding>"


def _without_head(text: str) -> str:
    return text[text.index("?>") + 2 :] if text.startswith("<?") else text


def ssv(*, units: Mapping[str, str] = UNITS, version: str = "1.0", **parameters: Any) -> str:
    """A parameter set: values, or a value with its unit or its type."""
    texts = []
    for name, entry_of_name in parameters.items():
        value, *more = entry_of_name if isinstance(entry_of_name, tuple) else (entry_of_name,)
        default = {bool: "Boolean", int: "Integer", float: "Real", str: "String"}[type(value)]
        type_ = next((m for m in more if m in TYPES), default)
        unit = next((m for m in more if m not in TYPES), None)
        inside = f"<ssv:{type_}{attributes(value=value, unit=unit)}/>"
        texts.append(f"<ssv:Parameter{attributes(name=name)}>{inside}</ssv:Parameter>")
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<ssv:ParameterSet {NAMESPACES} version="{version}" name="values"><ssv:Parameters>{"".join(texts)}
</ssv:Parameters>{_units("ssv:Units", "ssc:", units)}</ssv:ParameterSet>"""


def ssm(*entries: str, version: str = "1.0") -> str:
    """A parameter mapping of entries."""
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<ssm:ParameterMapping {NAMESPACES} version="{version}">{"".join(entries)}</ssm:ParameterMapping>"""


def entry(source: str, target: str, inside: str = "", **more: object) -> str:
    """An entry of a mapping, with its transformation inside."""
    return f"<ssm:MappingEntry{attributes(source=source, target=target, **more)}>{inside}</ssm:MappingEntry>"


# ---- files -------------------------------------------------------------------------------------


def folder(path: Path, **files: str | bytes | Path) -> Path:
    """A folder with these files: `a__fmu` is a.fmu; with a path, that file. `root` is SystemStructure.ssd."""
    for name, content in files.items():
        target = path / ("SystemStructure.ssd" if name == "root" else name.replace("__", "."))
        target.parent.mkdir(parents=True, exist_ok=True)
        data = content.read_bytes() if isinstance(content, Path) else content
        target.write_bytes(data.encode() if isinstance(data, str) else data)
    return path


def rooted(path: Path, *parts: str, files: Mapping[str, Any] | None = None, **more: str) -> Path:
    """A folder in `path` whose root system has these parts, with files beside it."""
    version = more.pop("version", "1.0")
    return folder(path / "ssp", root=ssd(system("root", *parts, **more), version=version), **(files or {}))


def packed(path: Path, unpacked: Path) -> Path:
    """A package with all files of a folder."""
    files = {str(f.relative_to(unpacked)): f.read_bytes() for f in unpacked.rglob("*") if f.is_file()}
    write_archive(path, files)
    return path


# ---- what they mean ----------------------------------------------------------------------------


@dataclass(frozen=True)
class Understood:
    """An SSP as it was read, and in the terms of its FMUs."""

    system: System
    plain: System
    notes: list[str]

    def wires(self) -> dict[str, tuple[float, float]]:
        """Factor and offset of every connection, by `a.y -> b.u`."""
        return {
            str(x): (x.transformation.factor, x.transformation.offset)
            for x in self.plain.connections
            if x.transformation is not None
        }

    def values(self, name: str) -> dict[str, Any]:
        """Start values of a component by the FMU's names."""
        return dict(self.plain.component(name).parameters)


def understood(path: Path) -> Understood:
    """What is read from an SSP."""
    with read_ssp(path) as document:
        interfaces = {c.name: read_interface(c.fmu) for c in document.system.components if c.fmu}
        return Understood(document.system, resolve_system(document.system, interfaces), document.notes)
