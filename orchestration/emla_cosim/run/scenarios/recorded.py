"""Load recorded runs from run.json: their scenario with their options."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_origin

from ...base.errors import CommandError
from ...base.files import read_text
from ...base.output_files import UNFINISHED_STATUS
from ..options import list_options, read_options, select_repeatable
from ..origin import RunOrigin
from ..run_record import PYTHON


@dataclass(frozen=True)
class RecordedRun:
    """A recorded run: its scenario, its options, and the whole record."""

    source: str
    overrides: Mapping[str, Any]
    content: Mapping[str, Any]

    def with_options(self, overrides: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the recorded options, overridden by others. Raise CommandError for wrong options."""
        return RunOrigin(overrides=self.overrides).updated(read_options(overrides)).overrides


def load_recorded_run(path: Path, overrides: Mapping[str, Any]) -> RecordedRun:
    """Load the run with this run.json to repeat it.

    Args:
        path: Path of run.json.
        overrides: Options that override the recorded ones.

    Raises:
        CommandError: If the file is not a run.json, if its run ended too early to have settings, or if the
            system or an option was an object of Python.
    """
    where = f"the record '{path}'"
    try:
        content = json.loads(read_text(path, "the record"))
    except (ValueError, RecursionError) as error:
        raise CommandError(f"{where} is not JSON: {error}.") from error
    if isinstance(content, dict) and content.get("status") == UNFINISHED_STATUS:
        raise CommandError(
            f"the run of '{path}' has not finished. Wait for it; if it was killed, run its scenario again."
        )
    if not (isinstance(content, dict) and isinstance(content.get("settings"), dict) and "source" in content):
        raise CommandError(
            f"{where} is not the record of a run, or its run ended too early; name another run.json."
        )
    source, changed = content["source"], content.get("changed")
    if source is None:
        raise CommandError(f"{where} has a system that was made in Python; repeat the run in Python.")
    # a record whose source is a record could load itself endlessly
    if not isinstance(source, str) or not source or source.lower().endswith(".json"):
        raise CommandError(f"{where} has the source {source!r}; it must be the name or path of a scenario.")
    if not isinstance(changed, dict):
        raise CommandError(f"{where} has no table 'changed' of the options.")
    # tables are merged with the recorded ones, so those must be readable
    replaced = {name for name, value in overrides.items() if not isinstance(value, Mapping)}
    remaining = {name: value for name, value in changed.items() if name not in replaced}
    _check_repeatable(remaining, where)
    return RecordedRun(source, read_options(select_repeatable(remaining), where), content)


def _check_repeatable(changed: Mapping[str, Any], where: str) -> None:
    """Raise CommandError for options that no record has, and for those that were objects of Python."""
    options = list_options()
    for name, value in changed.items():
        if name not in options:
            continue  # reading it gives a better message
        if not options[name].recorded:
            raise CommandError(f"{where} has the option '{name}', which no record has.")
        is_mapping = isinstance(value, dict) and get_origin(options[name].plain_type) is Mapping
        for item in value.values() if is_mapping else value if isinstance(value, list) else [value]:
            if isinstance(item, dict) and set(item) == {PYTHON}:
                raise CommandError(
                    f"{where} has the {options[name].noun} {item[PYTHON]}, an object of Python that no "
                    f"record can contain. Set {options[name].flag} too, or repeat the run in Python.",
                    option=name,
                )
