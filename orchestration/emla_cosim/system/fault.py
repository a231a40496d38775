"""Faults of signals: kinds, times and their text form."""

import math
import re
from dataclasses import dataclass

from ..base.errors import CommandError, check_choice
from ..base.quantities import read_quantity, split_quantity

KINDS = ("freeze", "offset", "gain", "constant")
"""The kinds of faults."""

# a unit has no `+` and no `@`, which separate the parts of a fault
_QUANTITY = r"[-+]?(?:\d+(?:[.,]\d*)?|[.,]\d+)(?:[eE][-+]?\d+)?\s*(?:[^\W\d][^@+]*|°[^@+]*|%)?"
_TEXT = re.compile(
    rf"(?P<signal>[^=]+)=(?P<kind>\w+)(?::(?P<value>{_QUANTITY}))?@(?P<start>{_QUANTITY})"
    rf"(?:\+(?P<duration>{_QUANTITY}))?"
)
_BETWEEN_FAULTS = re.compile(r",(?=(?:[^,@\[\]]|\[[^\]]*\])*=)")
"""A comma before the next signal; others are in indices, such as `u[1,2]`, and decimal commas."""


@dataclass(frozen=True)
class Fault:
    """Failure of a signal for some time.

    The fault of an output affects all its receivers, that of an input only this input.

    Args:
        signal: full name of the signal.
        kind: `freeze` keeps the last value, `offset` adds `value`, `gain` multiplies by it, `constant` sends
            it instead.
        start: start of the fault, in s.
        duration: duration in s. Default: to the end of the run.
        value: offset, gain or constant, in the unit of the signal, or a text with a unit such as "2 mm".

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
    value: float | str | None = None

    def __post_init__(self) -> None:
        check_choice("kind of fault", self.kind, KINDS)
        subject = f"the fault of {self.signal}"
        number = self.value
        if isinstance(number, str):
            number, unit = split_quantity(number, f"the value of {subject}")
            # a gain has no unit; that of another value is checked when its signal is known
            if self.kind == "gain" or not unit:
                number = read_quantity(str(self.value), f"the value of {subject}", "1")
                object.__setattr__(self, "value", number)
        if not math.isfinite(self.start):
            raise CommandError(f"{subject} begins at {self.start:g} s; that must be a finite number.")
        if self.duration is not None and not 0.0 < self.duration < math.inf:
            raise CommandError(f"{subject} lasts {self.duration:g} s; that must be a positive number.")
        if number is not None and not math.isfinite(number):
            raise CommandError(f"{subject} has the value {number:g}; that must be a finite number.")
        if (self.value is None) != (self.kind == "freeze"):
            needs = "keeps the last value of the signal; leave out" if self.kind == "freeze" else "needs"
            raise CommandError(f"{subject} is of the kind {self.kind}, which {needs} a value.")

    @classmethod
    def of_text(cls, text: str) -> "Fault":
        """Return the fault that a text describes: SIGNAL=KIND:VALUE@START+DURATION.

        Raises:
            CommandError: the text cannot be read.
        """
        match = _TEXT.fullmatch(text.strip())
        if match is None:
            raise CommandError(
                f"the fault '{text}' cannot be read; write SIGNAL=KIND:VALUE@START+DURATION, such as "
                "lift.plant.x_measured=offset:1e-3@1+0.1."
            )
        signal, label = match["signal"].strip(), f"the time of the fault '{text}'"
        start = read_quantity(match["start"], label, "s")
        length = match["duration"]
        duration = None if length is None else read_quantity(length, label, "s")
        return cls(signal, match["kind"], start, duration, match["value"])

    def __str__(self) -> str:
        value = "" if self.value is None else f":{self.value}"
        duration = "" if self.duration is None else f"+{self.duration!r}"
        return f"{self.signal}={self.kind}{value}@{self.start!r}{duration}"


def read_faults(text: str) -> list[Fault]:
    """Parse faults separated by commas.

    Raises:
        CommandError: If one is invalid.
    """
    return [Fault.of_text(part) for part in _BETWEEN_FAULTS.split(text)]
