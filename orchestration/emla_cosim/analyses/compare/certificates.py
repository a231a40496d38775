"""Stability certificates of RSBA's sets of gains, each beside a run."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Unpack

import polars

from ...base.errors import CommandError, RunError
from ...base.progress import Progress
from ...run.option_types import CompareOptions
from ...study.joint_certificates import JointCertificate, build_certificate_rows, certify
from ...study.loading import load
from ..frame.outputs import Outputs
from ..frame.report import Report, ReportTable, Section
from ..frame.session import Session
from .controller_variants import ALL, select_variants

CERTIFICATE = "certificate"
"""Name of the tables for `emla compare`."""


@dataclass(frozen=True)
class SetCertificate:
    """The certificates of all joints with one set of gains; `problem` is the reason if there are none."""

    gains: str
    joints: Sequence[JointCertificate]
    problem: str | None = None

    @property
    def table(self) -> ReportTable:
        """Constants, predicted bounds and simulated values, with a column for each joint."""
        figures = build_certificate_rows(self.joints)
        rows = [[label, *(f"{value:.4g}" for value in values), unit] for label, unit, values in figures]
        header = ["", *(joint.joint for joint in self.joints), "unit"]
        title = f"Certificate of {self.gains}: bounds of the proof beside the run, from 0.3 s on"
        return ReportTable(title, header, rows, texts=(0, len(header) - 1))


@dataclass(frozen=True)
class CertificateResult:
    """Certificates of several sets of gains in a scenario.

    Attributes:
        name: Name of the scenario.
        sets: Certificates by set of gains.
    """

    name: str
    sets: Sequence[SetCertificate]

    @property
    def rows(self) -> polars.DataFrame:
        """A row for each set of gains and figure, with its unit, and a column for each joint."""
        return polars.DataFrame(
            {"gains": item.gains, "figure": label, "unit": unit}
            | dict(zip((joint.joint for joint in item.joints), values, strict=True))
            for item in self.sets
            for label, unit, values in build_certificate_rows(item.joints)
        )

    def markdown(self) -> str:
        """Return the tables and remarks of all sets as Markdown."""
        lines = list[str]()
        for item in self.sets:
            lines += [f"## {item.gains}", "", f"{item.problem}\n" if item.problem else item.table.markdown()]
            for joint in item.joints:
                lines += [f"{joint.joint}:", "", *(f"- {remark}" for remark in joint.remarks), ""]
        return "\n".join(lines)


def certify_gains(
    scenario: str | Path,
    gains: Sequence[str] | None = None,
    *,
    output: str | Path | None = None,
    overwrite: bool = False,
    report: bool = False,
    progress: Progress | None = None,
    **options: Unpack[CompareOptions],
) -> CertificateResult:
    """Certify sets of gains of RSBA, each beside a run of the scenario.

    Args:
        scenario: Name or file of the scenario.
        gains: Sets of gains. Default: all.
        output: Folder for results.
        overwrite: Whether to replace files that emla did not write.
        report: Whether to write a page, certificate.html, into the folder.
        progress: Receives the progress.
        **options: Options as for `load`.

    Raises:
        CommandError: A set does not exist, or the scenario has no joint with RSBA.
        RunError: A file cannot be written.
    """
    session = Session(OUTPUTS, output=output, overwrite=overwrite, report=report, progress=progress)
    sets = list[SetCertificate]()
    with session.reserve_folder():
        variants = select_variants(["rsba"], gains or [ALL])
        session.progress.begin("certifying", len(variants), "sets of gains")
        for variant in variants:
            overrides: dict[str, Any] = {**options, "controller": "rsba", "gains": variant.gains}
            try:
                with load(scenario, **overrides).prepare() as simulation:
                    sets.append(SetCertificate(variant.gains, certify(simulation)))
            except CommandError:
                raise
            except RunError as error:
                sets.append(SetCertificate(variant.gains, (), str(error)))
            session.progress.advance(1)
        result = CertificateResult(Path(scenario).stem, sets)
        session.keep(result)
    return result


def build_report(result: CertificateResult) -> Report:
    """Return the report of certificates."""
    sections = list[Section]()
    for item in result.sets:
        problem = [] if item.problem is None else [f"{item.gains}: {item.problem}"]
        sections.append(Section(item.gains, problem, [item.table] if item.joints else []))
        remarks = [f"{joint.joint}: {remark}" for joint in item.joints for remark in joint.remarks]
        if remarks:
            sections.append(Section(f"Assumptions of {item.gains} that are not met", remarks, is_detail=True))
    return Report("Certificate", result.name, [f"gains {item.gains}" for item in result.sets], sections)


OUTPUTS = Outputs[CertificateResult](
    subject="certificates",
    name=CERTIFICATE,
    record=None,
    record_file="certificate.csv",
    tables={
        "certificate.csv": lambda result: result.rows.write_csv(),
        "certificate.md": CertificateResult.markdown,
    },
    report=build_report,
)
