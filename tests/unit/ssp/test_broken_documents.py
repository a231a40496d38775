"""Invalid documents are refused with a message that says what is wrong and where."""

from pathlib import Path
from typing import Any

import pytest

from emla_cosim.base.errors import CommandError
from emla_cosim.base.faults import accept_faults
from fmublock.archive import write_archive
from tests.support.hand_written_fmus import Fault
from tests.support.refusals import problem_of
from tests.support.ssp_documents import (
    NAMESPACES,
    UNITS,
    binding,
    component,
    connection,
    description,
    entry,
    fake_fmu,
    folder,
    linear,
    packed,
    rooted,
    ssd,
    ssm,
    ssv,
    system,
    table,
    understood,
)

DEFINITION, PACKAGE = "application/x-ssp-definition", "application/x-ssp-package"


def part(name: str, ports: str) -> str:
    return component(name, "a.fmu", ports)


A = part("a", "u:input y:output")
B = part("b", "u:input y:output")


@pytest.fixture(scope="module")
def fmu(tmp_path_factory: pytest.TempPathFactory) -> Path:
    variables = (
        "u:input:m w:input:K y:output:m s:input:String k:parameter:m n:parameter:Integer "
        "on:parameter:Boolean mode:parameter:Enumeration x:parameter:nowhere"
    )
    path = tmp_path_factory.mktemp("fmu") / "a.fmu"
    return fake_fmu(path, *variables.split(), units={**UNITS, "nowhere": ""})


FIRST, SECOND = connection("a.y -> b.u"), connection("b.y -> b.u")
NO_DIRECTION = "not lead from an output to an input"
THROUGH = system("s", connection("in -> out"), ports="in:input out:output")
BRANCH = system("t", part("a", "u:input"), connection("in -> a.u"), ports="in:input")
SAME_NAME = system("a_c", component("c", "a.fmu"))
INNER = system("i", A, connection("in -> a.u"), ports="in:input:mm", id="it")
INCH = part("a", "u:input:inch")
# shows the unit of the connector where a value passes it
KELVIN = part("c", "y:output"), connection("c.y -> a.u", suppress_unit_conversion=True)


def reused(ports: str) -> str:
    """A component that is the inner system, with these connectors."""
    return component("c", "#it", ports, type=DEFINITION)


@pytest.mark.parametrize(
    ("parts", "words"),
    [
        ((A, connection("a.y -> c.u")), ["a.y -> c.u", "element 'c'", "'root' has a"]),
        ((A, B, connection("a.z -> b.u")), ["a.z -> b.u", "'z'", "'a' has u and y"]),
        ((A, connection("a.y -> out")), ["a.y -> out", "'out'", "'root' has none"]),
        ((A, B, connection("a.y -> b.y")), ["a.y -> b.y", NO_DIRECTION]),
        ((A, B, connection("a.u -> b.u")), ["a.u -> b.u", NO_DIRECTION]),
        ((A, B, FIRST, SECOND), ["b.u", "two connections", "a.y -> b.u and b.y -> b.u"]),
        ((A, A), ["line", "'root'", "second element 'a'"]),
        ((part("a", "u:input u:input"),), ["second connector a.u"]),
        ((part("a", "u:output"),), ["a.u", "kind output", "input"]),
        ((A, part("b", "w:input"), connection("a.y -> b.w")), ["a.y -> b.w", "m and K"]),
        ((part("a", "u:input:K"), *KELVIN), ["the variable of a.u", "K and m"]),
        (
            (B, INCH, connection("b.y -> a.u")),
            ["b.y -> a.u", "units m and inch", "not defined", "`--lenient`"],
        ),
        ((A, B, connection("a.y -> b.u", table("Integer", _1=2))), ["a.y -> b.u", "IntegerMapping"]),
        ((A, B, connection("a.y -> b.u", linear("NaN"))), ["line", "factor nan"]),
        ((A, B, connection("a.y -> b.u", linear(1, "-INF"))), ["line", "offset -inf"]),
        ((component("a", "a.txt", type="text/plain"),), ["'a'", "type 'text/plain'"]),
        ((component("a", "#b"),), ["'a' refers to '#b'", "no system has this id"]),
        ((SAME_NAME, component("a_c.c", "a.fmu")), ["two components 'a_c.c'"]),
        ((THROUGH, BRANCH, connection("s.out -> s.in"), connection("s.out -> t.in")), ["s.out form a loop"]),
        ((INNER, reused("out:output")), ["'out' of the component 'c' is not one of '#it'"]),
        ((INNER, reused("in:output")), ["'in' of the component 'c' is of kind output", "input"]),
        ((INNER, reused("in:input:m")), ["'in' of the component 'c' is in m", "in mm"]),
    ],
)
def test_invalid_structures(parts: tuple, words: list, tmp_path: Path, fmu: Path) -> None:
    problem_of(rooted(tmp_path, *parts, files={"a__fmu": fmu}), "'SystemStructure.ssd'", *words)


@pytest.mark.parametrize(
    ("connectors", "words"),
    [
        ("y:output:Integer", "the connector a.y is of type Integer, but the variable is of type Real"),
        ("n:parameter:Real", "the connector a.n is of type Real, but the variable is of type Integer"),
        ("y:output absent:parameter", "the connector a.absent has no variable in 'a.fmu'"),
    ],
)
def test_connectors_that_differ_are_accepted_with_lenient(
    connectors: str, words: str, tmp_path: Path, fmu: Path
) -> None:
    """Other tools write such documents."""
    path = rooted(tmp_path, part("a", connectors), files={"a__fmu": fmu})
    with pytest.raises(CommandError, match=f"{words}.*--lenient"):
        understood(path)
    with accept_faults(lenient=True) as faults:
        assert understood(path).wires() == {}
    assert any(words in remark for remark in faults.remarks(None))


def test_connectors_of_a_text_are_refused(tmp_path: Path, fmu: Path) -> None:
    path = rooted(tmp_path, part("a", "s:input:Real"), files={"a__fmu": fmu})
    with accept_faults(lenient=True), pytest.raises(CommandError, match="the variable is of type String"):
        understood(path)


def test_component_without_a_source(tmp_path: Path) -> None:
    path = rooted(tmp_path, component("a", None), version="2.0")
    problem_of(path, "'SystemStructure.ssd'", "'a' has no source")


def holding(source: str, **more: object) -> str:
    """A structure with a component that refers to another document."""
    return ssd(system("s", component("c", source, type=DEFINITION), **more))


@pytest.mark.parametrize(
    "files",
    [
        {"root": holding("./SystemStructure.ssd")},
        {"root": holding("b.ssd"), "b__ssd": holding("SystemStructure.ssd")},
        {"root": holding("b.ssd"), "b__ssd": holding("b.ssd")},
        {"root": holding("#top", id="top")},
        {"root": holding("SystemStructure.ssd#top", id="top")},
    ],
)
def test_systems_that_contain_themselves(files: dict, tmp_path: Path) -> None:
    problem_of(folder(tmp_path, **files), "'c' refers to '", "which contains it")


def test_package_that_contains_itself(tmp_path: Path) -> None:
    inner = folder(tmp_path / "inner", root=holding("SystemStructure.ssd"))
    outer = rooted(tmp_path, component("p", "inner.ssp", type=PACKAGE))
    packed(outer / "inner.ssp", inner)
    path = packed(tmp_path / "outer.ssp", outer)
    problem_of(path, "'SystemStructure.ssd/inner.ssp", "'c' refers to 'SystemStructure.ssd'", "contains it")


def test_too_deep_and_too_many_references(tmp_path: Path) -> None:
    chain = {f"s{i}__ssd": holding(f"s{i + 1}.ssd") for i in range(60)}
    path = folder(tmp_path / "deep", root=holding("s0.ssd"), **chain)
    problem_of(path, "'SystemStructure.ssd/s0.ssd/", "'c' is nested more than 50 levels deep")
    doubled = [
        system(f"s{i}", *(component(n, f"#s{i + 1}", type=DEFINITION) for n in "ab"), id=f"s{i}")
        for i in range(40)
    ]
    problem_of(rooted(tmp_path, *doubled, system("last", id="s40")), "more than 10000 components")


# ---- XML ---------------------------------------------------------------------------------------

BOMB = "<!DOCTYPE x [<!ENTITY a 'ha'>" + "".join(
    f"<!ENTITY {new} '{10 * f'&{old};'}'>" for old, new in zip("abcdefghi", "bcdefghij", strict=True)
)
EXTERNAL = "<!DOCTYPE x [<!ENTITY j SYSTEM 'SECRET'>"
GOOD = {
    "ssd": ssd(system("root", component("a", "a.fmu", bindings=binding("a.ssv", "a.ssm")))),
    "ssv": ssv(k=1.0),
    "ssm": ssm(entry("k", "k")),
}
XML = {
    "empty": (lambda text: "", ["not well-formed"]),
    "text": (lambda text: "no XML", ["not well-formed", "line 1"]),
    "cut off": (lambda text: text[:-9], ["not well-formed", "line"]),
    "other root": (lambda text: f"<x {NAMESPACES}/>", ["has the root 'x'"]),
    "attribute": (
        lambda text: text.replace(" source=" if "MappingEntry" in text else " name=", " nonsense=", 1),
        ["line", "not valid SSP", "attribute"],
    ),
    "version": (lambda text: with_head(text, "", "1.0", "7.0"), ["line", "not valid SSP", "version"]),
    "expanded bomb": (lambda text: with_head(text, f"{BOMB}]>", ">", ">&j;"), []),
    "bomb": (lambda text: with_head(text, f"{BOMB}]>"), ["DOCTYPE"]),
    "external entity": (lambda text: with_head(text, f"{EXTERNAL}]>", ">", ">&j;"), ["DOCTYPE"]),
    "external": (lambda text: with_head(text, "<!DOCTYPE x SYSTEM 'SECRET'>"), ["DOCTYPE"]),
}


def with_head(text: str, head: str, old: str = "=", new: str = "=") -> str:
    """The document with something behind the XML declaration, and one change below."""
    declaration, body = text.split("?>", 1)
    return f"{declaration}?>{head}{body.replace(old, new, 1)}"


@pytest.mark.parametrize("kind", GOOD)
@pytest.mark.parametrize("name", XML)
def test_invalid_xml(kind: str, name: str, tmp_path: Path, fmu: Path) -> None:
    change, words = XML[name]
    secret = tmp_path / "file"
    secret.write_text("the secret")
    files = {"root": GOOD["ssd"], "a__ssv": GOOD["ssv"], "a__ssm": GOOD["ssm"]}
    text = change(GOOD[kind]).replace("SECRET", secret.as_uri())
    path = folder(tmp_path / "ssp", **{**files, "root" if kind == "ssd" else f"a__{kind}": text}, a__fmu=fmu)
    message = problem_of(path, "SystemStructure.ssd" if kind == "ssd" else f"a.{kind}", *words)
    assert "secret" not in message


def test_wrong_namespaces_are_named(tmp_path: Path) -> None:
    draft = "http://www.pmsf.net/xsd/SystemStructureDescriptionDraft"
    root = GOOD["ssd"].replace("http://ssp-standard.org/SSP1/SystemStructureDescription", draft)
    problem_of(folder(tmp_path, root=root), f"is in the namespace '{draft}'; SSP has it in 'http://ssp-stand")


@pytest.mark.parametrize(
    ("bound", "words"),
    [
        (binding(ssv(k=1.0).replace("<ssv:Real", "<ssv:Reel")), ["line", "Reel"]),
        (binding(ssv(k=1.0), ssm("<ssm:Entry/>")), ["line", "Entry"]),
        ("<ssd:ParameterBinding/>", ["line", "ParameterBinding has neither a source nor content"]),
    ],
)
def test_invalid_bindings(bound: str, words: list, tmp_path: Path, fmu: Path) -> None:
    path = rooted(tmp_path, component("a", "a.fmu", bindings=bound), files={"a__fmu": fmu})
    problem_of(path, "SystemStructure.ssd", *words)


OSP = (
    "<ssd:DefaultExperiment><ssd:Annotations><ssc:Annotation type='com.opensimulationplatform'>"
    "<osp:FixedStepAlgorithm xmlns:osp='http://opensimulationplatform.com/SSP/OSPAnnotations' "
    "baseStepSize='tiny'/></ssc:Annotation></ssd:Annotations></ssd:DefaultExperiment>"
)


@pytest.mark.parametrize(
    ("experiment", "words"),
    [
        (OSP, ["line", "step size 'tiny'"]),
        ("<ssd:DefaultExperiment startTime='soon'/>", ["line", "startTime"]),
        ("<ssd:DefaultExperiment startTime='INF'/>", ["inf"]),
        ("<ssd:DefaultExperiment startTime='NaN'/>", ["nan"]),
    ],
)
def test_invalid_times(experiment: str, words: list, tmp_path: Path, faulty_fmu: Path) -> None:
    root = ssd(system("root", component("a", "Faulty.fmu")), experiment=experiment)
    problem_of(folder(tmp_path, root=root, Faulty__fmu=faulty_fmu), *words)


# ---- values ------------------------------------------------------------------------------------

TWICE = "<ssv:Parameter name='k'><ssv:Real value='2'/></ssv:Parameter></ssv:Parameters>"


@pytest.mark.parametrize(
    ("content", "mapping", "words"),
    [
        (ssv(k=9.5).replace('"9.5"', '"NaN"'), "", ["line", "'k'", "NaN"]),
        (ssv(k=9.5).replace('"9.5"', '"INF"'), "", ["line", "'k'", "INF"]),
        (ssv(n=9.5).replace('"9.5"', '"-INF"'), "", ["line", "'n'", "-INF"]),
        (ssv(k=9.5).replace('"9.5"', '"much"'), "", ["line", "value", "much"]),
        (ssv(n=95).replace('"95"', '"1.5"'), "", ["line", "value", "1.5"]),
        (ssv(k=1.0, units={"x": 'm="1" factor="0"'}), "", ["line", "factor 0"]),
        (ssv(k=1.0, units={"x": 'm="1" factor="NaN"'}), "", ["line", "factor nan"]),
        (ssv(k=(1.0, "K")), "", ["parameter 'k' and a.k", "K and m"]),
        (ssv(k=(1.0, "inch")), "", ["parameter 'k' and a.k", "inch and m", "not defined"]),
        (ssv(x=(1.0, "m")), "", ["parameter 'x' and a.x", "m and nowhere", "not defined"]),
        (ssv(k=1.0).replace("</ssv:Parameters>", TWICE), "", ["line", "'k'", "second value"]),
        (ssv(k=1.0, n=2), ssm(entry("k", "k"), entry("n", "k")), ["line", "'n' to 'k'", "'k'"]),
        (ssv(k=1.0), ssm(entry("k", "k", linear("INF"))), ["line", "factor inf"]),
        (ssv(version="2.0", k=9.5).replace('"9.5"', '"1 2"'), "", ["line", "'k'", "2 values"]),
        (ssv(version="2.0", k=9.5).replace('"9.5"', '""'), "", ["line", "'k'", "0 values"]),
        (ssv(version="2.0", label="").replace('<ssv:String value=""/>', "<ssv:String/>"), "", ["0 values"]),
    ],
)
def test_invalid_parameters(content: str, mapping: str, words: list, tmp_path: Path, fmu: Path) -> None:
    part = component("a", "a.fmu", bindings=binding("k.ssv", "k.ssm" if mapping else ""))
    files = {"a__fmu": fmu, "k__ssv": content} | ({"k__ssm": mapping} if mapping else {})
    problem_of(rooted(tmp_path, part, files=files), "'", *words)


@pytest.mark.parametrize(
    ("start_values", "words"),
    [
        ({"b": "two"}, ["a.b", "two", "not a number"]),
        ({"fault": 99}, ["a.fault = 99", "out of range", f"at most {max(Fault)}"]),
        ({"fault": "none"}, ["a.fault", "none", "not a whole number"]),
    ],
)
def test_values_out_of_range(start_values: dict, words: list, tmp_path: Path, faulty_fmu: Path) -> None:
    part = component("a", "Faulty.fmu", bindings=binding(ssv(**start_values)))
    problem_of(rooted(tmp_path, part, files={"Faulty__fmu": faulty_fmu}), *words)


# ---- files -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("uri", "words"),
    [
        ("missing.fmu", ["'missing.fmu'", "does not exist"]),
        ("../a.fmu", ["'../a.fmu'", "outside"]),
        ("x/../../a.fmu", ["outside"]),
        ("%2e%2e/a.fmu", ["outside"]),
        ("/etc/passwd", ["'/etc/passwd'", "relative"]),
        ("file:///etc/passwd", ["'file:///etc/passwd'", "relative"]),
        ("http://localhost/a.fmu", ["'http://localhost/a.fmu'", "relative"]),
        ("//localhost/a.fmu", ["relative"]),
        ("x\\..\\a.fmu", ["relative"]),
        ("C:%5Ca.fmu", ["relative"]),
        ("http://[::1/a.fmu", ["anyURI"]),
        ("a%00.fmu", ["'a%00.fmu'", "relative"]),
        ("%", ["anyURI"]),
        (".", ["'.'", "does not exist"]),
    ],
)
def test_uris_of_all_kinds_of_files(uri: str, words: list, tmp_path: Path, fmu: Path) -> None:
    files = {"k__ssv": ssv(k=1.0), "real__fmu": fmu}
    (tmp_path / "a.fmu").write_bytes(fmu.read_bytes())
    for part in (
        component("a", uri),
        component("a", uri, type=DEFINITION),
        component("a", uri, type=PACKAGE),
        component("a", "real.fmu", bindings=binding(uri)),
        component("a", "real.fmu", bindings=binding("k.ssv", uri)),
    ):
        problem_of(rooted(tmp_path, part, files=files), "SystemStructure.ssd'", *words)


def test_links_that_lead_outside(tmp_path: Path, fmu: Path) -> None:
    path = rooted(tmp_path, component("a", "link.fmu"))
    (path / "link.fmu").symlink_to(fmu)
    problem_of(path, "'link.fmu'", "outside")


@pytest.mark.parametrize("uri", ["missing.ssv", "../modelDescription.xml", "/etc/passwd", "http://x/y.ssv"])
def test_files_that_are_not_inside_the_fmu(uri: str, tmp_path: Path, fmu: Path) -> None:
    part = component("a", "a.fmu", bindings=binding(uri, source_base="component"))
    problem_of(rooted(tmp_path, part, files={"a__fmu": fmu}), f"'{uri}' inside 'a.fmu'", "does not exist")


def test_missing_variants_of_a_structure(tmp_path: Path) -> None:
    path = folder(tmp_path / "ssp", B__ssd=ssd(system("root")))
    problem_of(path, "'SystemStructure.ssd'", "B.ssd", "#B.ssd'")
    problem_of(f"{path}#C.ssd", "'C.ssd'", "has B.ssd", f"{path}#B.ssd'")
    problem_of(packed(tmp_path / "p.ssp", path), "no 'SystemStructure.ssd'", "p.ssp#B.ssd")
    for fragment in ("C.ssd", "../B.ssd", "sub/B.ssd", "%00", "."):
        part = component("p", f"p.ssp#{fragment}", type=PACKAGE)
        problem_of(rooted(tmp_path / "o", part, files={"p__ssp": tmp_path / "p.ssp"}), "p.ssp#", "has B.ssd")


def test_variants_outside_of_their_package(tmp_path: Path, fmu: Path) -> None:
    outside = folder(tmp_path, outside__ssd=ssd(system("root", component("a", "a.fmu"))), a__fmu=fmu)
    path = folder(tmp_path / "v", B__ssd=ssd(system("root")))
    packed(tmp_path / "v.ssp", path)
    for fragment in ("../../../outside.ssd", f"{outside}/outside.ssd", "%2e%2e/../../outside.ssd"):
        part = component("p", f"v.ssp#{fragment}", type=PACKAGE)
        outer = rooted(tmp_path / "o", part, files={"v__ssp": tmp_path / "v.ssp"})
        problem_of(outer, "v.ssp#", "no 'outside.ssd'", "has B.ssd")
    (path / "link.ssd").symlink_to(outside / "outside.ssd")
    problem_of(f"{path}#link.ssd", "no 'link.ssd'")


# ---- FMUs --------------------------------------------------------------------------------------

FMI_3 = """<fmiModelDescription fmiVersion="3.0" modelName="a" instantiationToken="a">
<ModelExchange modelIdentifier="a"/><ModelVariables>
<Float64 name="time" valueReference="0" causality="independent" variability="continuous"/>
<Clock name="tick" valueReference="1" causality="input" intervalVariability="constant" intervalDecimal="1"/>
</ModelVariables><ModelStructure/></fmiModelDescription>"""
FMI_1 = """<fmiModelDescription fmiVersion="1.0" modelName="a" modelIdentifier="a" guid="a"
numberOfContinuousStates="0" numberOfEventIndicators="0"><ModelVariables/><Implementation>
<CoSimulation_StandAlone><Capabilities/></CoSimulation_StandAlone></Implementation></fmiModelDescription>"""
PLAIN = component("a", "a.fmu")
EXCHANGE = component("a", "a.fmu", implementation="ModelExchange")


@pytest.mark.parametrize(
    ("part", "content", "words"),
    [
        (PLAIN, b"not a zip", ["not an FMU", "zip"]),
        (PLAIN, None, ["not an FMU", "modelDescription.xml"]),
        (PLAIN, "no XML", ["not an FMU"]),
        (PLAIN, '<fmiModelDescription fmiVersion="1.0"/>', ["numberOfContinuousStates"]),
        (PLAIN, '<fmiModelDescription fmiVersion="7"/>', ["version: 7"]),
        (PLAIN, FMI_3, ["the clock 'tick'", "for co-simulation only"]),
        (PLAIN, FMI_1, ["FMI 1.0", "runs FMI 2.0"]),
        (PLAIN, description("a", "u:input:x", units={"x": 'm="1" factor="0"'}), ["unit 'x'", "factor 0"]),
        (EXCHANGE, description("a", "u:input"), ["has no ModelExchange, only CoSimulation"]),
    ],
)
def test_fmus_that_cannot_be_read(part: str, content: Any, words: list, tmp_path: Path) -> None:
    path = rooted(tmp_path, part)
    if isinstance(content, bytes):
        (path / "a.fmu").write_bytes(content)
    else:
        text = {"x": b""} if content is None else {"modelDescription.xml": content.encode()}
        write_archive(path / "a.fmu", text)
    problem_of(path, "a.fmu'", *words)


@pytest.mark.parametrize("head", [BOMB, EXTERNAL], ids=["bomb", "external"])
def test_entities_of_a_model_description(head: str, tmp_path: Path) -> None:
    secret = tmp_path / "file"
    secret.write_text("the secret")
    path = rooted(tmp_path, PLAIN)
    text = with_head(description("a", "u:input"), f"{head.replace('SECRET', str(secret))}]>")
    text = text.replace("<ModelVariables>", "<ModelVariables>&j;")
    write_archive(path / "a.fmu", {"modelDescription.xml": text.encode()})
    assert "the secret" not in problem_of(path, "a.fmu'")
