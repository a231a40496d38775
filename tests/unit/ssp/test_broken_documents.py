"""Documents that are wrong: refused with a sentence that says what and where."""

from pathlib import Path

import pytest

from fmublock.archive import write_archive
from tests.support.refusals import Refused, refusals
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
    ssd,
    ssm,
    ssv,
    system,
    table,
)

DEFINITION, PACKAGE = "application/x-ssp-definition", "application/x-ssp-package"
A = component("a", "a.fmu", "u:input y:output")
B = component("b", "a.fmu", "u:input y:output")


@pytest.fixture
def refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Refused:
    return refusals(tmp_path, monkeypatch)


@pytest.fixture
def fmu(tmp_path: Path) -> Path:
    return fake_fmu(
        tmp_path / "a.fmu",
        "u:input:m",
        "w:input:K",
        "y:output:m",
        "k:parameter:m",
        "n:parameter:Integer",
        "on:parameter:Boolean",
        "mode:parameter:Enumeration",
        "x:parameter:nowhere",
        units={**UNITS, "nowhere": ""},
    )


def check(sentence: str, *words: str) -> None:
    """All of the words are in it, in this order."""
    rest = sentence
    for word in words:
        assert word in rest, sentence
        rest = rest[rest.index(word) + len(word) :]


# ---- structure ---------------------------------------------------------------------------------

FIRST, SECOND = connection("a.y -> b.u"), connection("b.y -> b.u")


@pytest.mark.parametrize(
    ("parts", "words"),
    [
        ((A, connection("a.y -> c.u")), ["a.y -> c.u", "element 'c'", "'root' has a"]),
        ((A, B, connection("a.z -> b.u")), ["a.z -> b.u", "'z'", "'a' has u and y"]),
        ((A, connection("a.y -> out")), ["a.y -> out", "'out'", "'root' has none"]),
        ((A, B, connection("a.y -> b.y")), ["a.y -> b.y", "not lead from an output to an input"]),
        ((A, B, connection("a.u -> b.u")), ["a.u -> b.u", "not lead from an output to an input"]),
        ((A, B, FIRST, SECOND), ["b.u", "two connections", "a.y -> b.u and b.y -> b.u"]),
        ((A, A), ["line", "'root'", "second element 'a'"]),
        ((component("a", "a.fmu", "u:input u:input"),), ["second connector a.u"]),
        ((component("a", "a.fmu", "z:input"),), ["a.z", "no variable", "'a.fmu'"]),
        ((component("a", "a.fmu", "u:output"),), ["a.u", "kind output", "input"]),
        ((component("a", "a.fmu", "u:input:Integer"),), ["a.u", "type Integer", "Real"]),
        (
            (A, component("b", "a.fmu", "w:input"), connection("a.y -> b.w")),
            ["a.y -> b.w", "units m and K"],
        ),
        ((component("a", "a.fmu", "u:input:K"),), ["the connector and the variable of a.u", "K and m"]),
        ((B, component("a", "a.fmu", "u:input:inch"), connection("b.y -> a.u")),
         ["b.y -> a.u", "units m and inch", "not defined", "`--lenient`"]),
        ((A, B, connection("a.y -> b.u", table("Integer", _1=2))), ["a.y -> b.u", "IntegerMapping"]),
        ((A, B, connection("a.y -> b.u", linear("NaN"))), ["line", "factor nan"]),
        ((A, B, connection("a.y -> b.u", linear(1, "-INF"))), ["line", "offset -inf"]),
        ((component("a", "a.txt", type="text/plain"),), ["'a'", "type 'text/plain'"]),
        ((component("a", "#b"),), ["'a' refers to '#b'", "no system has this id"]),
        ((component("a", "a.fmu"), component("a_b", "a.fmu", id="a.b"),
          system("a.b"), system("a_c", component("c", "a.fmu")), component("a_c.c", "a.fmu")),
         ["two components 'a_c.c'"]),
    ],
)  # fmt: skip
def test_structures(parts: tuple, words: list, refused: Refused, tmp_path: Path, fmu: Path) -> None:
    # a connector in a unit that the variable does not have shows where a value passes it
    inputs = [p for p in parts if 'unit="K"' in p]
    more = [component("c", "a.fmu", "y:output"), connection("c.y -> a.u")] if inputs else []
    if inputs:
        more[-1] = connection("c.y -> a.u", suppress_unit_conversion=True)
    path = folder(tmp_path / "ssp", root=ssd(system("root", *parts, *more)), a__fmu=fmu)
    check(refused(path), "'SystemStructure.ssd'", *words)


def test_components_without_a_source(refused: Refused, tmp_path: Path) -> None:
    path = folder(tmp_path / "ssp", root=ssd(system("root", component("a", None)), version="2.0"))
    check(refused(path), "'SystemStructure.ssd'", "'a' has no source")


def test_connectors_in_a_circle(refused: Refused, tmp_path: Path, fmu: Path) -> None:
    through = system("s", connection("in -> out"), ports="in:input out:output")
    leads = connection("s.out -> s.in")
    branch = system("t", component("a", "a.fmu", "u:input"), connection("in -> a.u"), ports="in:input")
    root = system("root", through, branch, leads, connection("s.out -> t.in"))
    sentence = refused(folder(tmp_path / "ssp", root=ssd(root), a__fmu=fmu))
    check(sentence, "the connections of s.out form a loop")


def test_a_component_unlike_its_system(refused: Refused, tmp_path: Path, fmu: Path) -> None:
    inner = system("i", A, connection("in -> a.u"), ports="in:input:mm", id="it")
    for ports, words in (
        ("out:output", ["'out' of the component 'c' is not one of '#it'"]),
        ("in:output", ["'in' of the component 'c' is of kind output", "input"]),
        ("in:input:m", ["'in' of the component 'c' is in m", "in mm"]),
    ):
        root = system("root", inner, component("c", "#it", ports, type=DEFINITION))
        check(refused(folder(tmp_path / "ssp", root=ssd(root), a__fmu=fmu)), *words)


def test_systems_inside_themselves(refused: Refused, tmp_path: Path) -> None:
    def holding(source: str, **more: object) -> str:
        return ssd(system("s", component("c", source, type=DEFINITION), **more))

    for files in (
        {"root": holding("SystemStructure.ssd")},
        {"root": holding("./SystemStructure.ssd")},
        {"root": holding("b.ssd"), "b__ssd": holding("SystemStructure.ssd")},
        {"root": holding("b.ssd"), "b__ssd": holding("b.ssd")},
        {"root": holding("#top", id="top")},
        {"root": holding("SystemStructure.ssd#top", id="top")},
    ):
        check(refused(folder(tmp_path / "ssp", **files)), "'c' refers to '", "which contains it")


def test_a_package_inside_itself(refused: Refused, tmp_path: Path) -> None:
    inner = folder(
        tmp_path / "inner", root=ssd(system("s", component("c", "SystemStructure.ssd", type=DEFINITION)))
    )
    outer = folder(tmp_path / "outer", root=ssd(system("s", component("p", "inner.ssp", type=PACKAGE))))
    packed(outer / "inner.ssp", inner)
    sentence = refused(packed(tmp_path / "outer.ssp", outer))
    check(sentence, "'SystemStructure.ssd/inner.ssp", "'c' refers to 'SystemStructure.ssd'", "contains it")


def test_documents_too_deep_inside_each_other(refused: Refused, tmp_path: Path) -> None:
    chain = {
        f"s{i}__ssd": ssd(system("s", component("c", f"s{i + 1}.ssd", type=DEFINITION))) for i in range(60)
    }
    path = folder(tmp_path / "ssp", root=ssd(system("s", component("c", "s0.ssd", type=DEFINITION))), **chain)
    check(refused(path), "'SystemStructure.ssd/s0.ssd/", "'c' is nested more than 50 levels deep")


def test_references_that_make_many_of_few(refused: Refused, tmp_path: Path) -> None:
    doubled = [
        system(f"s{i}", *(component(n, f"#s{i + 1}", type=DEFINITION) for n in "ab"), id=f"s{i}")
        for i in range(40)
    ]
    path = folder(tmp_path / "ssp", root=ssd(system("root", *doubled, system("last", id="s40"))))
    check(refused(path), "more than 10000 components")


# ---- XML ---------------------------------------------------------------------------------------

BOMB = "<!DOCTYPE x [<!ENTITY a 'ha'>" + "".join(
    f"<!ENTITY {new} '{10 * f'&{old};'}'>" for old, new in zip("abcdefghi", "bcdefghij", strict=True)
)
EXTERNAL = "<!DOCTYPE x [<!ENTITY j SYSTEM 'file://SECRET'>"


@pytest.mark.parametrize("kind", ["ssd", "ssv", "ssm"])
def test_what_is_no_document(kind: str, refused: Refused, tmp_path: Path, fmu: Path) -> None:
    good = {"ssd": ssd(system("root", A)), "ssv": ssv(k=1.0), "ssm": ssm(entry("k", "k"))}[kind]
    secret = tmp_path / "secret"
    secret.write_text("the secret")
    head, body = good.split("?>", 1)
    for text, words in (
        ("", ["not well-formed"]),
        ("no XML", ["not well-formed", "line 1"]),
        (good[:-9], ["not well-formed", "line"]),
        (f"<x {NAMESPACES}/>", ["has the root 'x'"]),
        (good.replace("name=", "nonsense=", 1) if kind != "ssm" else good.replace("source=", "s="),
         ["line", "not valid SSP", "attribute"]),
        (f"{head}?>{body.replace('1.0', '7.0', 1)}", ["line", "not valid SSP", "version"]),
        (f"{head}?>{BOMB}]>{body.replace('>', '>&j;', 1)}", [""]),
        (f"{head}?>{BOMB}]>{body.replace('=', '=', 1)}", ["DOCTYPE"]),
        (f"{head}?>{EXTERNAL.replace('SECRET', str(secret))}]>{body.replace('>', '>&j;', 1)}", ["DOCTYPE"]),
        (f"{head}?><!DOCTYPE x SYSTEM 'file://{secret}'>{body}", ["DOCTYPE"]),
    ):  # fmt: skip
        bound = binding("a.ssv", "a.ssm")
        files = {
            "root": ssd(system("root", component("a", "a.fmu", bindings=bound))),
            "a__ssv": ssv(k=1.0),
            "a__ssm": ssm(entry("k", "k")),
        }
        name = {"ssd": "root", "ssv": "a__ssv", "ssm": "a__ssm"}[kind]
        sentence = refused(folder(tmp_path / "ssp", **{**files, name: text}, a__fmu=fmu))
        check(sentence, {"ssd": "SystemStructure.ssd"}.get(kind, f"a.{kind}"), *words)
        assert "secret" not in sentence.replace(str(secret), "")


def test_what_is_wrong_inside(refused: Refused, tmp_path: Path, fmu: Path) -> None:
    for bound, words in (
        (binding(ssv(k=1.0).replace("<ssv:Real", "<ssv:Reel")), ["line", "Reel"]),
        (binding(ssv(k=1.0), ssm("<ssm:Entry/>")), ["line", "Entry"]),
        ("<ssd:ParameterBinding/>", ["line", "ParameterBinding has neither a source nor content"]),
    ):
        root = system("root", component("a", "a.fmu", bindings=bound))
        check(refused(folder(tmp_path / "ssp", root=ssd(root), a__fmu=fmu)), "SystemStructure.ssd", *words)


def test_times_that_are_none(refused: Refused, tmp_path: Path, fmu: Path) -> None:
    osp = (
        "<ssd:Annotations><ssc:Annotation type='com.opensimulationplatform'><osp:FixedStepAlgorithm "
        "xmlns:osp='http://opensimulationplatform.com/SSP/OSPAnnotations' baseStepSize='tiny'/>"
        "</ssc:Annotation></ssd:Annotations>"
    )
    for experiment, words in (
        (f"<ssd:DefaultExperiment>{osp}</ssd:DefaultExperiment>", ["line", "step size 'tiny'"]),
        ("<ssd:DefaultExperiment startTime='soon'/>", ["line", "startTime"]),
        ("<ssd:DefaultExperiment startTime='INF'/>", ["inf"]),
        ("<ssd:DefaultExperiment startTime='NaN'/>", ["nan"]),
    ):
        path = folder(tmp_path / "ssp", root=ssd(system("root", A), experiment=experiment), a__fmu=fmu)
        check(refused(path), *words)


# ---- values ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("given", "mapping", "words"),
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
        (ssv(k=1.0).replace("</ssv:Parameters>", "<ssv:Parameter name='k'><ssv:Real value='2'/>"
                            "</ssv:Parameter></ssv:Parameters>"), "", ["line", "'k'", "second value"]),
        (ssv(k=1.0, n=2), ssm(entry("k", "k"), entry("n", "k")), ["line", "'n' to 'k'", "'k'"]),
        (ssv(k=1.0), ssm(entry("k", "k", linear("INF"))), ["line", "factor inf"]),
        (ssv(version="2.0", k=9.5).replace('"9.5"', '"1 2"'), "", ["line", "'k'", "2 values"]),
        (ssv(version="2.0", k=9.5).replace('"9.5"', '""'), "", ["line", "'k'", "0 values"]),
        (ssv(version="2.0", label="").replace('<ssv:String value=""/>', "<ssv:String/>"), "", ["0 values"]),
    ],
)  # fmt: skip
def test_parameters(
    given: str, mapping: str, words: list, refused: Refused, tmp_path: Path, fmu: Path
) -> None:
    root = system("root", component("a", "a.fmu", bindings=binding("k.ssv", "k.ssm" if mapping else "")))
    files = {"k__ssv": given} | ({"k__ssm": mapping} if mapping else {})
    check(refused(folder(tmp_path / "ssp", root=ssd(root), a__fmu=fmu, **files)), "'", *words)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"b": "two"}, ["a.b", "two", "not a number"]),
        ({"fault": 99}, ["a.fault = 99", "out of range", "at most 27"]),
        ({"fault": "none"}, ["a.fault", "none", "not a whole number"]),
    ],
)
def test_values_that_the_fmu_cannot_have(
    given: dict, words: list, refused: Refused, tmp_path: Path, faulty_fmu: Path
) -> None:
    root = system("root", component("a", "Faulty.fmu", bindings=binding(ssv(**given))))
    check(refused(folder(tmp_path / "ssp", root=ssd(root), Faulty__fmu=faulty_fmu)), *words)


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
def test_uris(uri: str, words: list, refused: Refused, tmp_path: Path, fmu: Path) -> None:
    """Whether an FMU, a document, a parameter set or a mapping is named."""
    del fmu  # lies outside
    path = folder(tmp_path / "ssp", k__ssv=ssv(k=1.0), real__fmu=tmp_path / "a.fmu")
    for part in (
        component("a", uri),
        component("a", uri, type=DEFINITION),
        component("a", uri, type=PACKAGE),
        component("a", "real.fmu", bindings=binding(uri)),
        component("a", "real.fmu", bindings=binding("k.ssv", uri)),
    ):
        folder(path, root=ssd(system("root", part)))
        check(refused(path), "SystemStructure.ssd'", *words)


def test_links_that_lead_outside(refused: Refused, tmp_path: Path, fmu: Path) -> None:
    path = folder(tmp_path / "ssp", root=ssd(system("root", component("a", "link.fmu"))))
    (path / "link.fmu").symlink_to(fmu)
    check(refused(path), "'link.fmu'", "outside")


@pytest.mark.parametrize("uri", ["missing.ssv", "../modelDescription.xml", "/etc/passwd", "http://x/y.ssv"])
def test_files_that_the_fmu_has_not(uri: str, refused: Refused, tmp_path: Path, fmu: Path) -> None:
    root = system("root", component("a", "a.fmu", bindings=binding(uri, source_base="component")))
    sentence = refused(folder(tmp_path / "ssp", root=ssd(root), a__fmu=fmu))
    check(sentence, f"'{uri}' inside 'a.fmu'", "does not exist")


def test_variants_that_are_not_there(refused: Refused, tmp_path: Path) -> None:
    path = folder(tmp_path / "ssp", B__ssd=ssd(system("root")))
    check(refused(path), "'SystemStructure.ssd'", "B.ssd", "#B.ssd'")
    check(refused(f"{path}#C.ssd"), "'C.ssd'", "has B.ssd", f"{path}#B.ssd'")
    check(refused(packed(tmp_path / "p.ssp", path)), "no 'SystemStructure.ssd'", "p.ssp#B.ssd")
    for fragment in ("C.ssd", "../B.ssd", "sub/B.ssd", "%00", "."):
        outer = folder(
            tmp_path / "outer", root=ssd(system("s", component("p", f"p.ssp#{fragment}", type=PACKAGE)))
        )
        folder(outer, p__ssp=tmp_path / "p.ssp")
        check(refused(outer), "p.ssp#", "has B.ssd")


def test_variants_outside_of_their_package(refused: Refused, tmp_path: Path, fmu: Path) -> None:
    """A good structure is there, but the package is somebody else's."""
    outside = folder(tmp_path, outside__ssd=ssd(system("root", component("a", "a.fmu"))), a__fmu=fmu)
    path = folder(tmp_path / "v", B__ssd=ssd(system("root")))
    packed(tmp_path / "v.ssp", path)
    for fragment in ("../../../outside.ssd", f"{outside}/outside.ssd", "%2e%2e/../../outside.ssd"):
        root = ssd(system("s", component("p", f"v.ssp#{fragment}", type=PACKAGE)))
        outer = folder(tmp_path / "outer", root=root, v__ssp=tmp_path / "v.ssp")
        check(refused(outer), "v.ssp#", "no 'outside.ssd'", "has B.ssd")
    (path / "link.ssd").symlink_to(outside / "outside.ssd")
    check(refused(f"{path}#link.ssd"), "no 'link.ssd'")


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"no zip", ["not an FMU", "zip"]),
        (b"", ["not an FMU"]),
        ({"x": b""}, ["not an FMU", "modelDescription.xml"]),
        ({"modelDescription.xml": b"no XML"}, ["not an FMU"]),
        ({"modelDescription.xml": b'<fmiModelDescription fmiVersion="1.0"/>'}, ["modelName"]),
        ({"modelDescription.xml": b'<fmiModelDescription fmiVersion="7"/>'}, ["version: 7"]),
    ],
)
def test_what_is_no_fmu(content: object, words: list, refused: Refused, tmp_path: Path) -> None:
    path = folder(tmp_path / "ssp", root=ssd(system("root", component("a", "a.fmu"))))
    if isinstance(content, dict):
        write_archive(path / "a.fmu", content)
    elif isinstance(content, bytes):
        (path / "a.fmu").write_bytes(content)
    check(refused(path), "a.fmu'", *words)


FMI_3 = """<fmiModelDescription fmiVersion="3.0" modelName="a" instantiationToken="a">
<ModelExchange modelIdentifier="a"/><ModelVariables>
<Float64 name="time" valueReference="0" causality="independent" variability="continuous"/>
<Clock name="tick" valueReference="1" causality="input" intervalVariability="constant" intervalDecimal="1"/>
</ModelVariables><ModelStructure/></fmiModelDescription>"""
FMI_1 = """<fmiModelDescription fmiVersion="1.0" modelName="a" modelIdentifier="a" guid="a"
numberOfContinuousStates="0" numberOfEventIndicators="0"><ModelVariables/><Implementation>
<CoSimulation_StandAlone><Capabilities/></CoSimulation_StandAlone></Implementation></fmiModelDescription>"""


def test_a_kind_that_the_fmu_does_not_have(refused: Refused, tmp_path: Path) -> None:
    one = component("a", "a.fmu", implementation="ModelExchange")
    path = folder(tmp_path / "ssp", root=ssd(system("root", one)))
    write_archive(path / "a.fmu", {"modelDescription.xml": description("a", "u:input").encode()})
    check(refused(path), "a.fmu'", "has no ModelExchange, only CoSimulation")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (FMI_3, ["the clock 'tick'", "for co-simulation only"]),
        (FMI_1, ["FMI 1.0", "runs FMI 2.0"]),
        (description("a", "u:input:x", units={"x": 'm="1" factor="0"'}), ["unit 'x'", "factor 0"]),
    ],
)
def test_fmus_of_other_kinds(text: str, words: list, refused: Refused, tmp_path: Path) -> None:
    path = folder(tmp_path / "ssp", root=ssd(system("root", component("a", "a.fmu"))))
    write_archive(path / "a.fmu", {"modelDescription.xml": text.encode()})
    check(refused(path), "a.fmu'", *words)


def test_entities_of_a_model_description(refused: Refused, tmp_path: Path) -> None:
    secret = tmp_path / "secret"
    secret.write_text("the secret")
    path = folder(tmp_path / "ssp", root=ssd(system("root", component("a", "a.fmu"))))
    head, body = description("a", "u:input").split("?>", 1)
    for kind in (BOMB, EXTERNAL.replace("SECRET", str(secret))):
        inside = body.replace("<ModelVariables>", "<ModelVariables>&j;")
        write_archive(path / "a.fmu", {"modelDescription.xml": f"{head}?>{kind}]>{inside}".encode()})
        sentence = refused(path)
        check(sentence, "a.fmu'")
        assert "the secret" not in sentence
