"""What the user may change about a run, and what follows from it."""

import difflib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

from .errors import CommandError, check_choice
from .master.algorithms.algorithm import Algorithm
from .master.algorithms.explicit import Explicit
from .master.algorithms.extrapolation import EXTRAPOLATIONS
from .master.algorithms.strong import Strong
from .master.simulation import ALGORITHMS
from .master.stepping.error_control import ErrorControl
from .master.stepping.fixed_steps import FixedSteps
from .master.stepping.stepping import Stepping
from .master.stepping.timing import Timing
from .models import FMU_FOLDER
from .replacement import Replacement
from .system.model import Value

DEFAULT_INTERVAL = 1e-3
"""Time in s between rows of results.csv unless told otherwise."""


@dataclass(frozen=True)
class Settings:
    """What the user may change about a run; None takes the scenario's, or the default. Times in s.

    `parameter_sets` are SSV files, which `values` override. `signals` are patterns of what results.csv
    is to hold, all without any. `error_tolerance` chooses the steps by their error,
    `coupling_tolerance` is what the strong algorithm agrees to, `multiples` gives components that
    step more rarely, `order` the order of stepping one after the other, `real_time` how many seconds
    to simulate per second. `platforms` are those that native FMUs are built for.
    """

    values: Mapping[str, Value] = field(default_factory=dict)
    parameter_sets: Sequence[Path] = ()
    replacements: Mapping[str, Replacement] = field(default_factory=dict)
    signals: Sequence[str] = ()
    algorithm: str | None = None
    extrapolation: str = "none"
    coupling_tolerance: float = 1e-8
    error_tolerance: float | None = None
    multiples: Mapping[str, int] = field(default_factory=dict)
    order: Sequence[str] = ()
    step_size: float | None = None
    stop_time: float | None = None
    output_interval: float | None = None
    flavour: str = "native"
    fmus: Path = FMU_FOLDER
    platforms: Sequence[str] = ()
    output: Path | None = None
    plots: bool = True
    compiled: bool = True
    real_time: float | None = None
    checkpoint: Path | None = None
    resume: Path | None = None

    @classmethod
    def merged(cls, *layers: Mapping[str, Any]) -> "Settings":
        """Settings by name from several layers: later ones win, tables are merged."""
        total: dict[str, Any] = {}
        for layer in layers:
            for name, value in layer.items():
                known = total.get(name)
                total[name] = {**known, **value} if isinstance(known, dict) else value
        return cls(**total)

    def make_algorithm(self, name: str) -> Algorithm:
        """The algorithm of this name with its options; CommandError where they do not fit."""
        check_choice("algorithm", name, ALGORITHMS)
        check_choice("extrapolation", self.extrapolation, EXTRAPOLATIONS)
        if not 0.0 < self.coupling_tolerance < 1.0:
            raise CommandError(f"the coupling tolerance {self.coupling_tolerance:g} must be between 0 and 1.")
        kind = ALGORITHMS[name]
        if issubclass(kind, Explicit):
            return kind(self.extrapolation, self.multiples)
        if self.multiples:
            raise CommandError(f"the algorithm {name} has no step multiples; jacobi and gauss-seidel have.")
        return Strong(self.extrapolation, self.coupling_tolerance)

    def make_stepping(self, algorithm: Algorithm, times: Timing) -> Stepping:
        """The stepping for an algorithm that is set up and initialized; CommandError as above."""
        if self.error_tolerance is not None:
            return ErrorControl(algorithm, times, self.error_tolerance, self.output_interval)
        for name, multiple in self.multiples.items():
            if times.steps % multiple:
                raise CommandError(
                    f"{times.steps} steps are no multiple of {multiple}, the steps that {name} does "
                    "at once; choose another stop time."
                )
        return FixedSteps(algorithm, times, self.compiled)

    def selected(self, names: Sequence[str]) -> list[int] | None:
        """Positions of the signals to record, None for all; CommandError for a pattern without any."""
        if not self.signals:
            return None
        chosen: set[int] = set()
        for pattern in self.signals:
            found = [i for i, name in enumerate(names) if name == pattern or fnmatchcase(name, pattern)]
            if not found:
                near = difflib.get_close_matches(pattern, names, n=3, cutoff=0.5)
                meant = f"did you mean {' or '.join(near)}?" if near else "results.csv shows all without."
                raise CommandError(f"no signal is called '{pattern}'; {meant}")
            chosen.update(found)
        return sorted(chosen)

    def record(self, algorithm: str, times: Timing) -> dict[str, object]:
        """The settings as run.json has them: what was in effect, for this algorithm and these times."""
        interval = self.output_interval
        if self.error_tolerance is None:
            interval = self.steps_per_row(times) * times.step
        return {
            "algorithm": algorithm,
            "start_time_s": times.start,
            "stop_time_s": times.stop,
            "step_size_s": times.step,
            "extrapolation": self.extrapolation,
            "coupling_tolerance": self.coupling_tolerance,
            "error_tolerance": self.error_tolerance,
            "step_multiples": self.multiples,
            "order": list(self.order),
            "output_interval_s": interval,
            "real_time_factor": self.real_time,
            "resumed_from": self.resume,
            "flavour": self.flavour,
            "parameters": list(self.parameter_sets),
            "set": self.values,
            "replace": self.replacements,
        }

    def steps_per_row(self, times: Timing) -> int:
        """Fixed steps in an output interval; without one 1 ms, or every step if that does not fit.

        Raises CommandError where the interval is not a whole number of steps.
        """
        interval = self.output_interval
        chosen = DEFAULT_INTERVAL if interval is None else interval
        if not 0.0 < chosen < float("inf"):
            raise CommandError(f"the output interval {chosen:g} s must be a positive number of seconds.")
        if self.error_tolerance is not None:
            return 1
        every = round(chosen / times.step)
        if every >= 1 and abs(every * times.step - chosen) <= 1e-9 * chosen:
            return every
        if interval is None:
            return max(every, 1)
        raise CommandError(
            f"the output interval {chosen:g} s is not a whole number of steps of {times.step:g} s."
        )
