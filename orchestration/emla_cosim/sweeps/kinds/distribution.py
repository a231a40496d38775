"""The base class of distributions."""

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from typing import Any, ClassVar, NoReturn, get_type_hints

from ...base.arrays import Vector
from ...base.errors import CommandError
from ...base.values import convert_value
from ...system.model import Value


@dataclass(frozen=True)
class Distribution(ABC):
    """Base class of distributions: how one quantity varies.

    Args:
        relative: whether values are factors of the nominal value of the quantity.

    Raises:
        CommandError: a value has a wrong type, is not finite, or leaves no range.
    """

    name: ClassVar[str]
    noun: ClassVar[str]
    """Its name in messages, with an article."""

    relative: bool = field(default=False, kw_only=True)

    def __post_init__(self) -> None:
        types = get_type_hints(type(self))
        for f in fields(self):
            label = f"{f.name} of {self.noun}"
            found = convert_value(getattr(self, f.name), types[f.name], label)
            if isinstance(found, float) and not math.isfinite(found):
                raise CommandError(f"{label} is {found}; it must be a finite number.", value=found)
            object.__setattr__(self, f.name, found)
        self._check()

    @abstractmethod
    def at(self, quantiles: Vector) -> list[Value]:
        """Return the inverse distribution function: a finite value for each quantile from 0 to 1."""

    @property
    def level_count(self) -> int | None:
        """The number of levels in a grid, without listing them; None if there are none."""
        return None

    @property
    def levels(self) -> Sequence[Value] | None:
        """The levels in a grid, in order; None if there are none."""
        return None

    @property
    @abstractmethod
    def ends(self) -> tuple[Value, Value]:
        """The lowest and highest value; without a bound, the 5 % or 95 % quantile."""

    @abstractmethod
    def _check(self) -> None:
        """Raise CommandError for inconsistent values."""

    def refuse(self, sentence: str, **found: Any) -> NoReturn:
        """Raise CommandError with a message that begins with the name of the distribution."""
        raise CommandError(f"{self.noun} {sentence}", distribution=self.name, **found)
