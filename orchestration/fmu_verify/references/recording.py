"""Record reference files from a run of the FMU itself, with inputs that excite it."""

import csv
import json
import math
from collections.abc import Callable, Iterable
from importlib.metadata import version
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
from fmpy.model_description import ModelVariable

from emla_cosim.base.arrays import Vector
from emla_cosim.base.errors import CommandError
from emla_cosim.base.files import resolve_output_path, write_atomically
from emla_cosim.base.output_files import OutputFile
from emla_cosim.fmu.elements import number_range

from ..confinement import confine
from ..host.experiment import OutputTrajectory, list_outputs, parse_number, read_limits, read_span
from ..settings import Recording
from ..subject import Subject
from ..subprocess_run import in_fresh_process
from .judgment import convert_values_by_name, run_reference, sample_inputs
from .reference_files import OPTIONS, ReferenceSolution, read_columns


def _make_steps(phase: Vector, number: int) -> Vector:
    """Step up, back, down and back, at different times for each input."""
    levels = np.array([0.0, 1.0, 0.0, -1.0])
    return levels[np.floor(4.0 * phase * (1.0 + 0.25 * (number % 4))).astype(int) % 4]


def _make_ramps(phase: Vector, number: int) -> Vector:
    """Ramp up, down and back, with different slopes for each input."""
    turns = (1.0 + 0.25 * (number % 4)) * phase
    return 2.0 * np.abs(2.0 * ((turns - 0.25) % 1.0) - 1.0) - 1.0


def _make_chirps(phase: Vector, number: int) -> Vector:
    """Sweep a sine from 1 to at least 10 periods per run."""
    last = 10.0 + 2.0 * (number % 4)
    return np.sin(2.0 * math.pi * (phase + 0.5 * (last - 1.0) * phase**2))


SHAPES: dict[str, Callable[[Vector, int], Vector]] = {
    "steps": _make_steps,
    "ramps": _make_ramps,
    "chirps": _make_chirps,
}
"""Shapes by name: functions of the phase (0 to 1) and the input's number, with values from -1 to 1."""


def excite_inputs(subject: Subject, shape: str, times: Vector) -> dict[str, Vector]:
    """Return columns for all numeric inputs, `time` in s first, within their ranges.

    Reals move by a quarter of their range around its middle, or else by a tenth of the nominal value
    around the start value. Integers, enumerations and Booleans take their allowed values.
    """
    phase = (times - times[0]) / (times[-1] - times[0])
    columns = {"time": times}
    inputs = [v for v in subject.description.modelVariables if v.causality == "input" and v.type != "String"]
    for index, variable in enumerate(inputs):
        columns[variable.name] = _excite_input(variable, SHAPES[shape](phase, index))
    return columns


def _excite_input(variable: ModelVariable, wave: Vector) -> Vector:
    """Return values of an input along a wave from -1 to 1, within its range."""
    if variable.type == "Boolean":
        return (wave > 0.5).astype(float)
    low, high = read_limits(variable)
    start = parse_number(variable.start, 0.0)
    if variable.type == "Enumeration" and variable.declaredType is not None:
        values = [int(str(item.value)) for item in variable.declaredType.items or []]
        low, high = (float(min(values)), float(max(values))) if values else (start, start)
    bounded = math.isfinite(low) and math.isfinite(high)
    middle = 0.5 * (low + high) if bounded else start
    width = 0.25 * (high - low) if bounded else 0.1 * abs(parse_number(variable.nominal, start or 1.0))
    if variable.type == "Integer":
        width = max(width, 1.0)  # less would be rounded to nothing
    wave = np.clip(middle + width * wave, low, high)
    return wave if variable.type == "Real" else np.round(np.clip(wave, *number_range(variable)))


MOST_STEPS = 100_000
"""Most steps of a recorded run."""

_ROWS = 1000
"""Approximate number of rows of generated inputs and recorded outputs."""


def check_recording(recording: Recording, fmus: Iterable[Path]) -> None:
    """Create the folder. Raise CommandError if files must not be overwritten, or two FMUs have one name.

    Check also that the FMUs have the start values and inputs, if their model descriptions are readable.
    """
    try:
        recording.folder.mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise CommandError(f"the folder '{recording.folder}' cannot be created: {reason}.") from error
    written: set[str] = set()
    for fmu in fmus:
        for path in recording.files(fmu.stem):
            target = resolve_output_path(path, "the reference")
            if str(target).casefold() in written:  # some file systems ignore case
                raise CommandError(f"two FMUs have the name {fmu.stem}; record one at a time.")
            if target.exists() and not recording.overwrite:
                raise CommandError(f"'{path}' already exists; to replace it, add --overwrite.")
            written.add(str(target).casefold())
        subject = Subject(fmu, recording.folder)
        try:
            _ = subject.description
        except Exception:  # the checks report it with more detail
            continue
        _choose_steps(subject, recording)
        convert_values_by_name(subject, recording.values)
        if recording.inputs is not None:
            columns, _ = read_columns(recording.inputs, "the inputs", subject.interface)
            sample_inputs(subject, columns, np.zeros(2))


def record_reference(subject: Subject, recording: Recording) -> list[Path]:
    """Run the FMU, write its reference files, and return their paths.

    Without inputs, a file of inputs from an earlier recording is removed.

    Raises:
        CallError: A call failed.
        CommandError: The inputs do not match the FMU.
        OSError: A file cannot be written.
    """
    start, step, count = _choose_steps(subject, recording)
    stop = start + count * step
    steps_per_row = max(1, count // _ROWS)
    times = np.asarray(start + step * np.arange(0, count + 1, steps_per_row), dtype=np.float64)
    if recording.inputs is not None:
        inputs, _ = read_columns(recording.inputs, "the inputs", subject.interface, start)
    else:
        inputs = excite_inputs(subject, recording.shape, times)
    names = list_outputs(subject)
    columns = {"time": times} | dict.fromkeys(names, times)
    plan = ReferenceSolution(columns, inputs, start, stop, step, steps_per_row * step, recording.values)
    trajectory = in_fresh_process(_run_confined, subject, plan)
    rows = {"time": trajectory.times} | {n: trajectory.values[:, i] for i, n in enumerate(trajectory.names)}
    options = zip(OPTIONS, (start, stop, step, steps_per_row * step), strict=True)
    texts = {
        "ref.csv": _format_csv(subject, rows),
        "ref.opt": "".join(f"{name}, {value!r}\n" for name, value in options),
        "ref.toml": _format_record(subject, recording),
    }
    if len(inputs) > 1:
        texts["in.csv"] = _format_csv(subject, inputs)
    else:  # the file of an earlier recording would be used as inputs
        (recording.folder / f"{subject.path.stem}_in.csv").unlink(missing_ok=True)
    written = {recording.folder / f"{subject.path.stem}_{kind}": text for kind, text in texts.items()}
    for path, text in written.items():
        file = OutputFile(path, "the reference", lambda _: False, recording.overwrite)
        with write_atomically(file.real_path, file.check_again) as stream:
            stream.write(text.encode())
    return list(written)


def _run_confined(subject: Subject, plan: ReferenceSolution) -> OutputTrajectory:
    """Run the FMU where it cannot write to the folder of the references."""
    confine([subject.scratch])
    return run_reference(subject, plan)


def _choose_steps(subject: Subject, recording: Recording) -> tuple[float, float, int]:
    """Return start and step in s, and the number of steps. Raise CommandError for invalid settings."""
    start, step, count = read_span(subject)
    if recording.step is not None:
        if not recording.step > 0.0:
            raise CommandError(f"the step size {recording.step:g} s must be a positive number.")
        step, count = recording.step, max(1, round(count * step / recording.step))
    if recording.stop is not None:
        if not recording.stop > start:
            raise CommandError(f"the stop time {recording.stop:g} s must be after the start, {start:g} s.")
        count = max(1, round((recording.stop - start) / step))
    if count > MOST_STEPS:
        message = f"{count} steps of {step:g} s are too many to record; set --stop-time or --step-size."
        raise CommandError(message)
    return start, step, count


def _format_csv(subject: Subject, columns: dict[str, Vector]) -> str:
    """Format columns as CSV: Reals with all digits, other types as whole numbers, Booleans as 0 and 1."""
    variables = [subject.variables.get(name) for name in columns]
    convert = [float if v is None or v.type == "Real" else int for v in variables]
    text = StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(
        [repr(to(value)) for to, value in zip(convert, row, strict=True)]
        for row in zip(*columns.values(), strict=True)
    )
    return text.getvalue()


def _format_record(subject: Subject, recording: Recording) -> str:
    """Return the text of the TOML file: what made the reference, and its start values."""
    driven = f"inputs of {recording.inputs.name}" if recording.inputs else f"{recording.shape} as inputs"
    description = subject.description
    made_by = (
        f"emla verify --record, {version('emla-cosim')}: {subject.path.name} (GUID {description.guid}, "
        f"{description.generationTool or 'unnamed tool'}) with {driven}"
    )
    values = "".join(f"{_format_toml(n)} = {_format_toml(v)}\n" for n, v in recording.values.items())
    return f"made_by = {_format_toml(made_by)}\n" + (f"\n[set]\n{values}" if values else "")


def _format_toml(value: Any) -> str:
    text = json.dumps(value, ensure_ascii=False)  # TOML has the numbers and escapes of JSON
    return "".join(c if c.isprintable() else f"\\U{ord(c):08x}" for c in text)
