"""Documents of an SSP: inside each other, as packages and folders, of both versions; names and times."""

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from emla_cosim.ssp.reader.flat_document import read_ssp
from tests.support.ssp_documents import (
    binding,
    component,
    connection,
    entry,
    fake_fmu,
    folder,
    linear,
    packed,
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


def inner(bindings: str = "", **more: object) -> str:
    """A system of one component, whose input and output it shows in mm."""
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


def check_two(path: Path) -> None:
    """The bindings of the components come after those of the system inside, and 5 are in mm."""
    found = understood(path)
    assert [c.name for c in found.system.components] == ["first.a", "second.a"]
    assert found.wires() == {"first.a.y -> second.a.u": pytest.approx((1.0, 5e-3))}
    assert (found.values("first.a"), found.values("second.a")) == ({"k": 2.0}, {"k": 3.0})


def test_another_ssd_as_component(tmp_path: Path, fmu: Path) -> None:
    path = folder(tmp_path / "ssp", root=two("sub/inner.ssd", DEFINITION))
    folder(path / "sub", a__fmu=fmu, inner__ssd=ssd(inner(binding("k.ssv"))), k__ssv=ssv(**{"a.k": 2.0}))
    check_two(path)


def test_another_ssp_as_component(tmp_path: Path, fmu: Path) -> None:
    inside = folder(tmp_path / "inner", root=ssd(inner(binding(ssv(**{"a.k": 2.0})))), a__fmu=fmu)
    path = folder(tmp_path / "ssp", root=two("inner.ssp", PACKAGE))
    packed(path / "inner.ssp", inside)
    check_two(path)
    check_two(packed(tmp_path / "outer.ssp", path))


def test_a_system_of_the_same_document_as_component(tmp_path: Path, fmu: Path) -> None:
    """It is an element as well, on its own."""
    definition = inner(binding(ssv(**{"a.k": 2.0})), id="the-one")
    found = understood(folder(tmp_path / "ssp", root=two("#the-one", DEFINITION, definition), a__fmu=fmu))
    assert [c.name for c in found.system.components] == ["first.a", "second.a", "inner.a"]
    assert found.wires() == {"first.a.y -> second.a.u": pytest.approx((1.0, 5e-3))}
    assert [found.values(f"{name}.a")["k"] for name in ("first", "second", "inner")] == [2.0, 3.0, 2.0]


def test_a_system_of_another_document_as_component(tmp_path: Path, fmu: Path) -> None:
    other = ssd(system("other", inner(binding(ssv(**{"a.k": 2.0})), id="it"), component("not", "a.fmu")))
    path = folder(tmp_path / "ssp", root=two("inner.ssd#it", DEFINITION), inner__ssd=other, a__fmu=fmu)
    check_two(path)


def test_units_that_only_the_component_declares(tmp_path: Path, fmu: Path) -> None:
    plain = ssd(inner(binding(ssv(**{"a.k": 2.0}))).replace('<ssc:Real unit="mm"/>', "<ssc:Real/>", 1))
    check_two(folder(tmp_path / "ssp", root=two("i.ssd", DEFINITION), i__ssd=plain, a__fmu=fmu))


# ---- where it lies -----------------------------------------------------------------------------


@pytest.fixture
def variants(tmp_path: Path, fmu: Path) -> Path:
    """A folder with two structures that differ in a value."""

    def one(k: float) -> str:
        return ssd(system("root", component("a", "resources/a.fmu", "u:input", binding(ssv(k=k)))))

    path = folder(tmp_path / "variants", root=one(1.0), B__ssd=one(2.0))
    folder(path / "resources", a__fmu=fmu)
    return path


def test_folder_package_and_document_mean_the_same(variants: Path, tmp_path: Path) -> None:
    package = packed(tmp_path / "variants.ssp", variants)
    for path in (variants, package, variants / "SystemStructure.ssd"):
        assert understood(path).values("a") == {"k": 1.0}
    for path in (f"{variants}#B.ssd", f"{package}#B.ssd", variants / "B.ssd"):
        assert understood(Path(path)).values("a") == {"k": 2.0}


def test_a_variant_of_a_package_inside(variants: Path, tmp_path: Path) -> None:
    path = tmp_path / "outer"
    path.mkdir()
    packed(path / "v.ssp", variants)
    for source, k in (("v.ssp", 1.0), ("v.ssp#B.ssd", 2.0), ("v.ssp#%42.ssd", 2.0)):
        folder(path, root=ssd(system("root", component("s", source, type=PACKAGE))))
        assert understood(path).values("s.a") == {"k": k}


def test_fmus_are_there_until_the_end(
    variants: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(temporary))
    with read_ssp(packed(tmp_path / "v.ssp", variants)) as document:
        (component_,) = document.system.components
        assert component_.fmu is not None and component_.fmu.is_file()
        assert list(temporary.iterdir()) != []
    assert list(temporary.iterdir()) == []


def test_a_package_may_be_called_like_a_variant(variants: Path, tmp_path: Path) -> None:
    assert understood(packed(tmp_path / "x#B.ssp", variants)).values("a") == {"k": 1.0}
    shutil.copy(tmp_path / "x#B.ssp", tmp_path / "y")
    assert understood(tmp_path / "y").values("a") == {"k": 1.0}


# ---- versions, times, names --------------------------------------------------------------------


def test_documents_of_version_2(tmp_path: Path, fmu: Path) -> None:
    other = fake_fmu(tmp_path / "b.fmu", "u:input:m", "k:parameter:m", "n:parameter:Integer")
    given = ssv(version="2.0", k=(2e3, "Float64", "mm"), n=(4, "Int32"))
    mapping = ssm(entry("k", "k", linear(2.0)), entry("n", "n"), version="2.0")
    root = system(
        "root",
        component("a", "a.fmu", "y:output:Float64"),
        component("b", "b.fmu", "u:input:Float64:mm n:parameter:Int32", binding("b.ssv", "b.ssm")),
        connection("a.y -> b.u"),
    )
    files = {"a__fmu": fmu, "b__fmu": other, "b__ssv": given, "b__ssm": mapping}
    found = understood(folder(tmp_path / "ssp", root=ssd(root, version="2.0"), **files))
    assert found.wires() == {"a.y -> b.u": pytest.approx((1.0, 0.0))}
    assert found.values("b") == {"k": 4.0, "n": 4}


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
    ("experiment", "annotation", "expected"),
    [
        ("", "", (None, None, None)),
        ('startTime="1" stopTime="2.5"', "", (1.0, 2.5, None)),
        ('stopTime="2.5"', OSP, (None, 2.5, 0.5)),
        ('stopTime="2.5"', OMS, (None, 2.5, 0.25)),
        ('stopTime="2.5"', CVODE, (None, 2.5, 0.25)),
    ],
)
def test_times(experiment: str, annotation: str, expected: tuple, tmp_path: Path) -> None:
    inside = annotation if annotation == OSP else ""
    root = (
        system("root").replace("</ssd:System>", f"{annotation}</ssd:System>")
        if inside == ""
        else system("root")
    )
    text = ssd(root, experiment=f"<ssd:DefaultExperiment {experiment}>{inside}</ssd:DefaultExperiment>")
    with read_ssp(folder(tmp_path, root=text)) as document:
        assert (document.start_time, document.stop_time, document.step_size) == expected


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
    found = understood(folder(tmp_path / "ssp", root=ssd(system("root", *parts)), a__fmu=fmu))
    assert [c.name for c in found.system.components] == expected


def test_an_id_inside_a_system_is_no_name(tmp_path: Path, fmu: Path) -> None:
    """It is written at the top level alone; deeper ones are of whoever made the package."""
    inside = system("s", component("lift_plant", "a.fmu", id="lift.plant"), component("b", "a.fmu", id="b"))
    called_so = system("tilt_plant", component("a", "a.fmu", id="tilt.plant"))
    root = system("root", inside, called_so, component("crane_pump", "a.fmu", id="crane.pump"))
    found = understood(folder(tmp_path / "ssp", root=ssd(root), a__fmu=fmu))
    names = [c.name for c in found.system.components]
    assert names == ["s.lift_plant", "s.b", "tilt_plant.a", "crane.pump"]


def test_the_xml_library_is_loaded_with_the_first_document() -> None:
    """Commands that read and write none do not wait for it."""
    code = (
        "import sys\n"
        "import emla_cosim.ssp.reader.flat_document, emla_cosim.ssp.writer.package_writer, "
        "emla_cosim.fmu.file\n"
        "from emla_cosim.ssp.documents.parameter_sets import format_mapping\n"
        "before = 'lxml' in sys.modules\n"
        "format_mapping(())\n"
        "print(before, 'lxml' in sys.modules)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "True"]
