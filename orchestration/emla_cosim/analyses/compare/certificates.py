"""Stability certificates of several sets of gains, each beside a run."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import polars

from ...base.errors import CommandError, RunError
from ...base.progress import Progress
from ...study.joint_certificates import JointCertificate, build_certificate_rows, certify
from ...study.loading import load
from ...views.folder import Folder
from .controller_variants import ALL, select_variants

CSV, MARKDOWN = "certificate.csv", "certificate.md"


@dataclass(frozen=True)
class SetCertificate:
    """The certificates of all joints with one set of gains; `problem` is the reason if there are none."""

    gains: str
    joints: Sequence[JointCertificate]
    problem: str | None = None


def certify_gains(
    scenario: str, gains: Sequence[str] | None, progress: Progress, **options: Any
) -> list[SetCertificate]:
    """Certify sets of gains of RSBA, by default all, each beside a run of the scenario.

    Raises:
        CommandError: A set does not exist, or the scenario has no joint with RSBA.
    """
    sets = [one.gains for one in select_variants(["rsba"], gains or [ALL])]
    progress.begin("certifying", len(sets), "sets of gains")
    found = []
    for gain_set in sets:
        chosen = load(scenario, controller="rsba", gains=gain_set, **options)
        try:
            with chosen.prepare() as simulation:
                found.append(SetCertificate(gain_set, certify(simulation)))
        except CommandError:
            raise
        except RunError as error:
            found.append(SetCertificate(gain_set, (), str(error)))
        progress.advance(1)
    return found


def build_frame(found: Sequence[SetCertificate]) -> polars.DataFrame:
    """Return a row for each set of gains and figure, with its unit, and a column for each joint."""
    rows = [
        {"gains": one.gains, "figure": label, "unit": unit}
        | dict(zip((joint.joint for joint in one.joints), values, strict=True))
        for one in found
        for label, unit, values in build_certificate_rows(one.joints)
    ]
    return polars.DataFrame(rows)


def markdown(found: Sequence[SetCertificate]) -> str:
    """Return the tables and remarks of all sets as Markdown."""
    return "\n".join(line for one in found for line in _section(one))


def _section(one: SetCertificate) -> list[str]:
    lines = [f"## {one.gains}", ""]
    if one.problem is not None:
        return [*lines, one.problem, ""]
    names = [joint.joint for joint in one.joints]
    lines += [f"| | {' | '.join(names)} | unit |", f"|---|{'---:|' * len(names)}---|"]
    for label, unit, values in build_certificate_rows(one.joints):
        lines.append(
            f"| {label.replace('|', chr(92) + '|')} | {' | '.join(f'{x:.4g}' for x in values)} | {unit} |"
        )
    for joint in one.joints:
        lines += ["", f"{joint.joint}:", "", *(f"- {remark}" for remark in joint.remarks)]
    return [*lines, ""]


class CertificateFolder(Folder):
    """The folder of certificates; see `Folder` for errors."""

    what = "certificates"
    files = (CSV, MARKDOWN)
    record_file = CSV

    def keep(self, found: Sequence[SetCertificate]) -> None:
        """Write figures and tables, each file atomically. Raises RunError."""
        self.write(CSV, build_frame(found).write_csv().encode())
        self.write(MARKDOWN, markdown(found).encode())
