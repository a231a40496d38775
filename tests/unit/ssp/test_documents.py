"""Documents of an SSP: inside each other, as packages and folders, of both versions; names and times."""

import tempfile
from pathlib import Path

import pytest

from emla_cosim.ssp.reader.flat_document import read_ssp
from emla_cosim.study.loading import load
from emla_cosim.views.output_folder import results_folder
from fmublock.archive import write_archive
from tests.support.ssp_documents import (
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
    understood,
)

DEFINITION, PACKAGE = "application/x-ssp-definition", "application/x-ssp-package"


@pytest.fixture
def fmu(tmp_path: Path) -> Path:
    return fake_fmu(tmp_path / "a.fmu", "u:input:m", "y:output:m", "k:parameter:m")


def inner(bindings: str = binding(ssv(**{"a.k": 2.0})), **more: object) -> str:
    """A system of one component, whose input and output are connectors in mm."""
    return system(
        "inner",
        component("a", "a.fmu", "u:input y:output", binding(ssv(k=1.0))),
        connection("in -> a.u"),
        connection("a.y -> out"),
        ports="in:input:mm out:output:mm",
        bindings=bindings,
        **more,
    )


def two(source: str, type_: str, *more: str) -> str:
    """Two components that are the inner system, one driving the other; the second has a binding."""
    return ssd(
        system(
            "root",
            component("first", source, "out:output", type=type_),
            component("second", source, "in:input:mm", binding(ssv(**{"a.k": 3.0})), type=type_),
            connection("second.in -> first.out", linear(offset=5.0)),
            *more,
        )
    )


def check_two(path: Path, more: list[str] | None = None) -> None:
    """The bindings of the components come after those of the system inside, and 5 are in mm."""
    actual = understood(path)
    assert [c.name for c in actual.system.components] == ["first.a", "second.a", *(more or [])]
    assert actual.wires() == {"first.a.y -> second.a.u": pytest.approx((1.0, 5e-3))}
    assert (actual.values("first.a"), actual.values("second.a")) == ({"k": 2.0}, {"k": 3.0})


def test_ssd_in_a_folder_as_component(tmp_path: Path, fmu: Path) -> None:
    path = folder(tmp_path / "ssp", root=two("sub/inner.ssd", DEFINITION))
    folder(path / "sub", a__fmu=fmu, inner__ssd=ssd(inner(binding("k.ssv"))), k__ssv=ssv(**{"a.k": 2.0}))
    check_two(path)


def test_ssp_as_component(tmp_path: Path, fmu: Path) -> None:
    inside = folder(tmp_path / "inner", root=ssd(inner()), a__fmu=fmu)
    path = folder(tmp_path / "ssp", root=two("inner.ssp", PACKAGE))
    packed(path / "inner.ssp", inside)
    check_two(path)
    check_two(packed(tmp_path / "outer.ssp", path))


def test_systems_with_an_id_as_components(tmp_path: Path, fmu: Path) -> None:
    """A system of the same document is an element as well, on its own; so may one of another document be."""
    same = two("#the-one", DEFINITION, inner(id="the-one"))
    check_two(folder(tmp_path / "same", root=same, a__fmu=fmu), ["inner.a"])
    second = ssd(system("second", inner(id="it"), component("not", "a.fmu")))
    root = two("inner.ssd#it", DEFINITION)
    check_two(folder(tmp_path / "second", root=root, inner__ssd=second, a__fmu=fmu))


def test_units_that_only_the_component_declares(tmp_path: Path, fmu: Path) -> None:
    plain = ssd(inner().replace('<ssc:Real unit="mm"/>', "<ssc:Real/>", 1))
    check_two(folder(tmp_path / "ssp", root=two("i.ssd", DEFINITION), i__ssd=plain, a__fmu=fmu))


# ---- packages and variants ---------------------------------------------------------------------


@pytest.fixture
def variants(tmp_path: Path, fmu: Path) -> Path:
    """A folder with two structures that differ in a value."""

    def variant(k: float) -> str:
        return ssd(system("root", component("a", "resources/a.fmu", "u:input", binding(ssv(k=k)))))

    path = folder(tmp_path / "variants", root=variant(1.0), B__ssd=variant(2.0))
    folder(path / "resources", a__fmu=fmu)
    return path


def test_folder_package_and_document_mean_the_same(variants: Path, tmp_path: Path) -> None:
    package = packed(tmp_path / "variants.ssp", variants)
    for path in (variants, package, variants / "SystemStructure.ssd"):
        assert understood(path).values("a") == {"k": 1.0}
    for path in (f"{variants}#B.ssd", f"{package}#B.ssd", variants / "B.ssd"):
        assert understood(Path(path)).values("a") == {"k": 2.0}
    for name in ("x#B.ssp", "y"):  # a package may have the name of a variant, and no suffix
        assert understood(packed(tmp_path / name, variants)).values("a") == {"k": 1.0}


def test_variant_of_a_package_as_component(variants: Path, tmp_path: Path) -> None:
    packed(tmp_path / "v.ssp", variants)
    for source, k in (("v.ssp", 1.0), ("v.ssp#B.ssd", 2.0), ("v.ssp#%42.ssd", 2.0)):
        part = component("s", source, type=PACKAGE)
        path = rooted(tmp_path, part, files={"v__ssp": tmp_path / "v.ssp"})
        assert understood(path).values("s.a") == {"k": k}


def test_fmus_are_unpacked_until_the_document_is_closed(
    variants: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(temporary))
    with read_ssp(packed(tmp_path / "v.ssp", variants)) as document:
        (part,) = document.system.components
        assert part.fmu is not None and part.fmu.is_file()
        assert list(temporary.iterdir()) != []
    assert list(temporary.iterdir()) == []


# ---- versions, times, names --------------------------------------------------------------------


def test_documents_of_version_2(tmp_path: Path, fmu: Path) -> None:
    root = (
        component("a", "a.fmu", "y:output:Float64"),
        component("b", "b.fmu", "u:input:Float64:mm n:parameter:Int32", binding("b.ssv", "b.ssm")),
        connection("a.y -> b.u"),
    )
    files = {
        "a__fmu": fmu,
        "b__fmu": fake_fmu(tmp_path / "b.fmu", "u:input:m", "k:parameter:m", "n:parameter:Integer"),
        "b__ssv": ssv(version="2.0", k=(2e3, "Float64", "mm"), n=(4, "Int32")),
        "b__ssm": ssm(entry("k", "k", linear(2.0)), entry("n", "n"), version="2.0"),
    }
    actual = understood(rooted(tmp_path, *root, files=files, version="2.0"))
    assert actual.wires() == {"a.y -> b.u": pytest.approx((1.0, 0.0))}
    assert actual.values("b") == {"k": 4.0, "n": 4}


OMS = (
    "<ssd:Annotations><ssc:Annotation type='org.openmodelica'><oms:Annotations xmlns:oms="
    "'https://raw.githubusercontent.com/OpenModelica/OMSimulator/master/schema/oms.xsd'>"
    "<oms:SimulationInformation><oms:FixedStepMaster description='oms-ma' stepSize='0.25'/>"
    "</oms:SimulationInformation></oms:Annotations></ssc:Annotation></ssd:Annotations>"
)
CVODE = OMS.replace("FixedStepMaster", "VariableStepSolver").replace("stepSize", "maximumStepSize")
OSP = (
    "<ssd:Annotations><ssc:Annotation type='com.opensimulationplatform'><osp:Algorithm xmlns:osp="
    "'http://opensimulationplatform.com/SSP/OSPAnnotations'><osp:FixedStepAlgorithm baseStepSize='0.5'/>"
    "</osp:Algorithm></ssc:Annotation></ssd:Annotations>"
)


@pytest.mark.parametrize(
    ("experiment", "of_system", "of_experiment", "expected"),
    [
        ("", "", "", (None, None, None)),
        ('startTime="1" stopTime="2.5"', "", "", (1.0, 2.5, None)),
        ('stopTime="2.5"', "", OSP, (None, 2.5, 0.5)),
        ('stopTime="2.5"', OMS, "", (None, 2.5, 0.25)),
        ('stopTime="2.5"', CVODE, "", (None, 2.5, 0.25)),
    ],
)
def test_times(experiment: str, of_system: str, of_experiment: str, expected: tuple, tmp_path: Path) -> None:
    root = system("root").replace("</ssd:System>", f"{of_system}</ssd:System>")
    times = f"<ssd:DefaultExperiment {experiment}>{of_experiment}</ssd:DefaultExperiment>"
    with read_ssp(folder(tmp_path, root=ssd(root, experiment=times))) as document:
        assert (document.start_time, document.stop_time, document.step_size) == expected


SLOW = '<DefaultExperiment stopTime="2" stepSize="0.01"/>'
FAST = '<DefaultExperiment stopTime="3" stepSize="0.005"/>'


def without_times(path: Path, first: str, second: str) -> Path:
    """A package of two FMUs with these default experiments, and without times of its own."""
    for name, variable, times in (("a", "y:output", first), ("b", "u:input", second)):
        text = description(name, variable).replace("<ModelVariables>", f"{times}<ModelVariables>")
        write_archive(path / f"{name}.fmu", {"modelDescription.xml": text.encode()})
    parts = component("a", "a.fmu", "y:output"), component("b", "b.fmu", "u:input"), connection("a.y -> b.u")
    return rooted(path, *parts, files={f"{n}__fmu": path / f"{n}.fmu" for n in "ab"})


@pytest.mark.parametrize(
    ("first", "second", "stop", "step", "of_fmus"),
    [(SLOW, FAST, 3.0, 0.005, True), (SLOW, "", 2.0, 0.01, True), ("", "", 10.0, 0.01, False)],
)
def test_default_times_come_from_the_fmus(
    tmp_path: Path, first: str, second: str, stop: float, step: float, of_fmus: bool
) -> None:
    scenario = load(without_times(tmp_path, first, second))
    assert (scenario.options.stop_time, scenario.options.step_size) == (stop, step)
    assert scenario.notes == (
        f"the package has no stop time; without --stop-time it runs for {stop:g} s"
        + ", the longest of its FMUs" * of_fmus,
        f"the package has no step size; without --step-size it is {step:g} s"
        + ", the shortest of its FMUs" * of_fmus,
    )


def test_times_of_the_user_override_default_times(tmp_path: Path) -> None:
    path = without_times(tmp_path, SLOW, "")
    scenario = load(path, stop_time=0.5, step_size=0.25)
    assert (scenario.options.stop_time, scenario.options.step_size, scenario.notes) == (0.5, 0.25, ())
    short_scenario = load(path, stop_time=0.005)  # shorter than the steps of the FMUs
    assert (short_scenario.options.stop_time, short_scenario.options.step_size) == (
        0.005,
        pytest.approx(5e-6),
    )
    assert len(short_scenario.notes) == 1


@pytest.mark.parametrize(
    ("names", "ids", "expected"),
    [
        (("lift_plant",), ("lift.plant",), ["lift.plant"]),
        (("lift_plant",), (None,), ["lift_plant"]),
        (("lift.plant",), (None,), ["lift.plant"]),
        (("lift_plant",), ("lift.pump",), ["lift_plant"]),
        (("a_b_c", "a_b.c"), ("a.b.c", None), ["a.b.c", "a_b.c"]),
    ],
)
def test_names_of_components(names: tuple, ids: tuple, expected: list, tmp_path: Path, fmu: Path) -> None:
    parts = [component(n, "a.fmu", id=i) for n, i in zip(names, ids, strict=True)]
    actual = understood(rooted(tmp_path, *parts, files={"a__fmu": fmu}))
    assert [c.name for c in actual.system.components] == expected


def test_only_ids_of_the_top_level_are_names(tmp_path: Path, fmu: Path) -> None:
    """Deeper ones belong to the author of the package."""
    parts = (
        system("s", component("lift_plant", "a.fmu", id="lift.plant"), component("b", "a.fmu", id="b")),
        system("tilt_plant", component("a", "a.fmu", id="tilt.plant")),
        component("crane_pump", "a.fmu", id="crane.pump"),
    )
    actual = understood(rooted(tmp_path, *parts, files={"a__fmu": fmu}))
    names = [c.name for c in actual.system.components]
    assert names == ["s.lift_plant", "s.b", "tilt_plant.a", "crane.pump"]


@pytest.mark.parametrize(
    ("name", "folder"), [("study", "study"), ("../../x", "x"), ("/etc", "etc"), ("a b", "a_b"), ("..", "run")]
)
def test_name_of_a_document_gives_a_folder_below_results(name: str, folder: str) -> None:
    assert results_folder(name) == Path("results") / folder
