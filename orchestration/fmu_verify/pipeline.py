"""Verify FMUs in a pipeline: the step that the action for GitHub and the component for GitLab share.

    python -P -m fmu_verify.pipeline FOLDER

The inputs are environment variables with one value per line, so that no shell ever reads them: VERIFY_FMUS
has globs, and VERIFY_ONLY and the others of `OPTIONS` have values of these options. The reports are written
to FOLDER, which may have those of an earlier run. The exit code is that of `emla verify`.
"""

import glob
import json
import os
import subprocess
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from emla_cosim.base.extras import has_extra

from .ci_summary import format_ci_summary

OPTIONS = ("reference", "only", "skip", "fail-on", "must-run", "tolerance")
REPORTS = {
    "junit": "junit.xml",
    "json": "report.json",
    "html": "report.html",
    "sarif": "report.sarif",
    "badge": "badge.svg",
}
CODE_QUALITY = "code-quality.json"

_SEVERITIES = {"error": "major", "warning": "minor", "note": "info"}
"""Severities of GitLab's Code Quality by level of SARIF."""


class NoFilesError(Exception):
    """A glob matches no file. The message says why."""


def find_files(globs: str) -> list[str]:
    """Return the files that match globs, in their order. Raise NoFilesError if one matches none."""
    files: list[str] = []
    for pattern in filter(None, globs.splitlines()):
        # Path.glob has no absolute patterns; a name with brackets is a name, too
        matches = sorted(glob.glob(pattern, recursive=True))  # noqa: PTH207
        if not matches and not Path(pattern).exists():
            raise NoFilesError(f"The input fmus has '{pattern}', which matches no file.")
        files += matches or [pattern]
    if not files:
        raise NoFilesError("The input fmus is empty.")
    return list(dict.fromkeys(files))


def list_options(environment: Mapping[str, str]) -> Iterator[str]:
    """Yield the options of `emla verify` that the inputs ask for."""
    for name in OPTIONS:
        lines = environment.get(f"VERIFY_{name.upper().replace('-', '_')}", "").splitlines()
        yield from (f"--{name}={line}" for line in lines if line)


def convert_to_code_quality(sarif: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the results of a SARIF report as entries of a Code Quality report, which GitLab reads."""
    return [
        {
            "description": result["message"]["text"].partition("\n")[0],
            "check_name": result["ruleId"],
            "fingerprint": result["partialFingerprints"]["primaryLocationLineHash"],
            "severity": _SEVERITIES[result["level"]],
            "location": {
                "path": unquote(result["locations"][0]["physicalLocation"]["artifactLocation"]["uri"]),
                "lines": {"begin": 1},
            },
        }
        for result in sarif["runs"][0]["results"]
    ]


def main() -> None:
    """Verify, write the reports, and exit with the code of `emla verify`."""
    folder = Path(sys.argv[1])
    files = {kind: folder / name for kind, name in REPORTS.items()}
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for file in (*files.values(), folder / CODE_QUALITY):
            file.unlink(missing_ok=True)  # none may be that of an earlier run
        fmus = find_files(os.environ.get("VERIFY_FMUS", ""))
    except OSError as error:
        _report_error(f"The folder of reports '{folder}' cannot be used: {error.strerror or error}.")
        sys.exit(2)
    except NoFilesError as error:
        _report_error(str(error))
        sys.exit(2)
    if not has_extra("plots"):
        del files["html"]
        print("report.html is left out, because the extra 'plots' is missing.", flush=True)
    command = [sys.executable, "-P", "-m", "emla_cosim", "verify", *list_options(os.environ)]
    command += [f"--{kind}={file}" for kind, file in files.items()]
    code = subprocess.run([*command, "--", *fmus], check=False).returncode
    if files["json"].is_file():
        _summarize(files["json"])
    if files["sarif"].is_file():
        entries = convert_to_code_quality(json.loads(files["sarif"].read_text(encoding="utf-8")))
        (folder / CODE_QUALITY).write_text(json.dumps(entries, indent=1), encoding="utf-8")
    # a signal that ends the program has a negative code
    sys.exit(code if code >= 0 else 1)


def _summarize(report: Path) -> None:
    """Add a summary to the page of a run on GitHub."""
    if page := os.environ.get("GITHUB_STEP_SUMMARY"):
        with Path(page).open("a", encoding="utf-8") as stream:
            stream.write(format_ci_summary(json.loads(report.read_text(encoding="utf-8"))))


def _report_error(message: str) -> None:
    """Show an error message; GitHub also shows it on the page of the run."""
    if os.environ.get("GITHUB_ACTIONS") == "true":
        escaped = message.replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A")
        print(f"::error title=FMUs were not verified::{escaped}", flush=True)
    else:
        print(f"Error: {message}", file=sys.stderr)


if __name__ == "__main__":
    main()
