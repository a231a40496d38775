"""Faults of signals: kinds, times and their text form."""

import math
import re
from dataclasses import dataclass

from ..base.errors import CommandError, check_choice

KINDS = ("freeze", "offset", "gain", "constant")
"""The kinds of faults."""

_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_TEXT = re.compile(
    rf"(?P<signal>[^=]+)=(?P<kind>\w+)(?::(?P<value>{_NUMBER}))?@(?P<start>{_NUMBER})"
    rf"(?:\+(?P<duration>{_NUMBER}))?"
)

_COMMA = re.compile(r",(?![^\[\]]*\])")
"""A comma outside of brackets, which have the indices of an element."""


@dataclass(frozen=True)
class Fault:
    """Failure of a signal for some time.

    The fault of an output affects all its receivers, that of an input only this input.

    Args:
        signal: full name of the signal.
        kind: `freeze` keeps the last value, `offset` adds `value`, `gain` multiplies by it, `constant` is it.
        start: start of the fault, in s.
        duration: duration in s. Default: to the end of the run.
        value: offset, gain or constant, in the unit of the signal.

    Raises:
        CommandError: the arguments contradict each other.

    Examples:
        >>> import emla_cosim as ec
        >>> str(ec.Fault("lift.plant.x_measured", "offset", start=1.0, duration=0.1, value=1e-3))
        'lift.plant.x_measured=offset:0.001@1.0+0.1'
    """

    signal: str
    kind: str
    start: float
    duration: float | None = None
    value: float | None = None

    def __post_init__(self) -> None:
        """Check the fields.

        Raises:
            CommandError: If a field is invalid.
        """
        check_choice("kind of fault", self.kind, KINDS)
        of = f"the fault of {self.signal}"
        if not math.isfinite(self.start):
            raise CommandError(f"{of} begins at {self.start:g} s; that must be a finite number.")
        if self.duration is not None and not 0.0 < self.duration < math.inf:
            raise CommandError(f"{of} lasts {self.duration:g} s; that must be a positive number.")
        if self.value is not None and not math.isfinite(self.value):
            raise CommandError(f"{of} has the value {self.value:g}; that must be a finite number.")
        if (self.value is None) != (self.kind == "freeze"):
            needs = "keeps the last value of the signal; leave out" if self.kind == "freeze" else "needs"
            raise CommandError(f"{of} is of the kind {self.kind}, which {needs} a value.")

    @classmethod
    def of_text(cls, text: str) -> "Fault":
        """Return the fault that a text describes: SIGNAL=KIND:VALUE@START+DURATION.

        Raises:
            CommandError: the text cannot be read.
        """
        found = _TEXT.fullmatch(text.strip())
        if found is None:
            raise CommandError(
                f"the fault '{text}' cannot be read; write SIGNAL=KIND:VALUE@START+DURATION, such as "
                "lift.plant.x_measured=offset:1e-3@1+0.1."
            )
        numbers = {n: None if found[n] is None else float(found[n]) for n in ("duration", "value")}
        return cls(found["signal"].strip(), found["kind"], float(found["start"]), **numbers)

    def __str__(self) -> str:
        value = "" if self.value is None else f":{self.value!r}"
        duration = "" if self.duration is None else f"+{self.duration!r}"
        return f"{self.signal}={self.kind}{value}@{self.start!r}{duration}"


def read_faults(text: str) -> list[Fault]:
    """Parse faults separated by commas.

    Raises:
        CommandError: If one is invalid.
    """
    return [Fault.of_text(part) for part in _COMMA.split(text)]
