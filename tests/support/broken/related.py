"""FMUs with related files, as FMI-LS-REF lists them: good ones, and one for each role that has a fault."""

import hashlib
import zipfile
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

from emla_cosim.fmu.parameters.parameter_sets import ParameterSet, SsvParameter, format_parameter_set
from fmu_verify.check import Verdict
from fmu_verify.host.experiment import make_experiment, step_instance
from fmu_verify.host.hosted_instance import HostedInstance
from fmublock.recipe import RELATED, RELATED_LIST
from tests.support.broken.broken import Broken, name_fault
from tests.support.broken.dynamic import build_good_fmu
from tests.support.broken.editing import Build
from tests.support.broken.examining import unpacked

EXPERIMENTS = "application/x-ma-hs-experiments"
SSV = "application/x-ssp-parameter-set"
Related = Mapping[str, tuple[str, str, str | bytes]]
"""Role, type and content of related files, by name. Files without a role are not listed."""


def build_with_related(folder: Path, name: str, related: Related) -> Path:
    """Build the good FMU with related files."""
    path = build_good_fmu(folder, name=name)
    listed = "".join(
        f'<Related type="{type_}" source="{file}" role="{role}" description="{role}"/>'
        for file, (role, type_, _) in related.items()
        if role
    )
    manifest = (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        '<fmiReferences xmlns:fmi-ls="http://fmi-standard.org/fmi-ls-manifest" '
        'fmi-ls:fmi-ls-name="org.fmi-standard.fmi-ls-ref" fmi-ls:fmi-ls-version="1.0.0-alpha.1" '
        'fmi-ls:fmi-ls-description="Layered Standard providing information on related files included in an '
        f'FMU.">{listed}</fmiReferences>\n'
    )
    with zipfile.ZipFile(path, "a", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(RELATED_LIST, manifest)
        for file, (_, _, content) in related.items():
            archive.writestr(f"{RELATED}/{file}", content)
    return path


def experiment(inside: str = "", name: str = "E", **attributes: object) -> str:
    """Return a file with one experiment."""
    settings = "".join(f' {key}="{value}"' for key, value in attributes.items())
    return f'<Experiments name="all"><Experiment name="{name}"{settings}>{inside}</Experiment></Experiments>'


def parameter_set(**values: float) -> bytes:
    """Return a parameter set of Reals."""
    return format_parameter_set(
        ParameterSet("set", tuple(SsvParameter(n, "Real", v) for n, v in values.items()))
    )


def meta_data(**attributes: str) -> str:
    """Return simulation resource meta-data."""
    settings = "".join(f' {key}="{value}"' for key, value in attributes.items())
    return (
        "<srmd:SimulationResourceMetaData "
        'xmlns:srmd="http://ssp-standard.org/SSPTraceability1/SimulationResourceMetaData" '
        'xmlns:stc="http://ssp-standard.org/SSPTraceability1/SSPTraceabilityCommon"'
        f' version="1.0.0"{settings}><stc:Classification type="a.b"><stc:ClassificationEntry keyword="k">v'
        "</stc:ClassificationEntry></stc:Classification></srmd:SimulationResourceMetaData>"
    )


def checksum(content: bytes) -> str:
    """Return the checksum of SRMD."""
    return hashlib.sha3_256(content).hexdigest()


@cache
def serialized_state() -> bytes:
    """Return a state of the good FMU at t = 0.1 s."""
    with TemporaryDirectory() as folder:
        subject = unpacked(build_good_fmu(Path(folder)))
        course, instance = make_experiment(subject), HostedInstance(subject)
        instance.initialize(course.at(0), float(course.times[0]))
        step_instance(instance, course, 0, 10)
        state = instance.save_state()
        data = instance.serialize(state)
        instance.free_state(state)
        instance.close()
    assert isinstance(data, bytes)
    return bytes(data)


RISING = "time,u\n0,0\n1,1\n"
"""Inputs of experiments."""

_REST = "time,position,moving\n0,0.01,0\n0.5,0.01,0\n"
"""A solution that does not move."""


def _with(name: str, related: Related) -> Build:
    return lambda folder: build_with_related(folder, name, related)


def _fails(words: str, what: str, check: str, related: Related, verdict: Verdict = Verdict.FAILED) -> Broken:
    name = name_fault("related", words)
    return Broken(name, what, check, _with(name, related), verdict=verdict)


_REFERENCES = '<References source="ref.csv"/>'

# fmt: off
RELATED_FILES: list[Broken] = [
    _fails("smoke reference", "a smoke test in the FMU has other results", "related.smoke_tests", {
        "a.exp": ("experiment", EXPERIMENTS, experiment(_REFERENCES, stopTime=0.5)),
        "ref.csv": ("", "", _REST)}),
    _fails("smoke input", "a smoke test in the FMU drives an input that does not exist",
        "related.smoke_tests", {
        "a.exp": ("experiment/smoke-test", EXPERIMENTS, experiment('<Stimuli source="in.csv"/>')),
        "in.csv": ("", "", RISING.replace("u", "force"))}),
    _fails("smoke times", "a smoke test in the FMU ends before it starts", "related.smoke_tests", {
        "a.exp": ("experiment", EXPERIMENTS, experiment(startTime=1, stopTime=0.5))}),
    _fails("validation reference", "a validation in the FMU has other results", "related.validation", {
        "a.exp": ("experiment/validation", EXPERIMENTS, experiment(_REFERENCES, stopTime=0.5)),
        "ref.csv": ("", "", _REST)}),
    _fails("validation set", "a validation in the FMU sets an output", "related.validation", {
        "a.exp": ("experiment/validation", EXPERIMENTS, experiment('<Parameters source="p.ssv"/>')),
        "p.ssv": ("", "", parameter_set(position=1.0))}),
    _fails("uncertainty set", "the parameter set of an uncertainty analysis is not in the FMU",
        "related.uncertainty", {
        "a.exp": ("experiment/uncertainty-analysis", EXPERIMENTS,
            experiment('<Parameters source="p.ssv"/>'))}),
    _fails("parameter name", "a parameter set in the FMU sets what does not exist", "related.parameters", {
        "p.ssv": ("parameter", SSV, parameter_set(gain=2.0, mass=1.0))}, Verdict.WARNING),
    _fails("parameter range", "a parameter set in the FMU has a value out of range", "related.parameters", {
        "p.ssv": ("parameter", SSV, parameter_set(u=11.0))}),
    _fails("state bytes", "a serialized state in the FMU is that of another build", "related.states", {
        "a.state": ("serialized-state", "application/octet-stream", b"state of another build")}),
    _fails("result column", "a result in the FMU has a column that is no variable", "reference.agrees", {
        "a_ref.csv": ("result", "text/csv", "time,place\n0,0\n0.5,0\n"),
        "a_in.csv": ("", "", RISING)}, Verdict.WARNING),
    _fails("parameter type", "a parameter set in the FMU has a text for a Real", "related.parameters", {
        "p.ssv": ("parameter", SSV, parameter_set(gain=2.0).replace(b"Real", b"String"))}),
    _fails("meta data name", "meta-data in the FMU have no name", "related.metadata", {
        "a.srmd": ("meta-data", "application/x-srmd-meta-data", meta_data())}),
    _fails("meta data checksum", "meta-data in the FMU have the checksum of another file",
        "related.metadata", {
        "a.srmd": ("meta-data", "application/x-srmd-meta-data",
            meta_data(name="m", data="p.ssv", checksum=checksum(b"another"))),
        "p.ssv": ("parameter", SSV, parameter_set(gain=2.0))}),
]
# fmt: on
