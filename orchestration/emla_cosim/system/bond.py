"""Power bonds of a system: an effort that one component gives, and the flow that another answers with."""

from dataclasses import dataclass

from ..base.errors import CommandError


@dataclass(frozen=True)
class Bond:
    """Two signals by their full names whose product is a power, such as a force and a speed.

    One component gives the effort to another, which gives the flow back.
    """

    effort: str
    flow: str

    def __str__(self) -> str:
        return f"{self.effort} * {self.flow}"

    def with_names(self, **names: object) -> "Bond":
        """Return the bond with these names in the place of their placeholders, such as {joint}."""
        return Bond(self.effort.format(**names), self.flow.format(**names))

    @classmethod
    def read(cls, name: str, text: str) -> "Bond":
        """Read EFFORT * FLOW, a bond of this name; CommandError for any other text."""
        effort, flow, *more = [part.strip() for part in text.split("*")] + [""]
        if not effort or not flow or any(more):
            raise CommandError(
                f"the bond {name} is '{text}'; write two signals, such as 'load.F * actuator.v'.", bond=name
            )
        return cls(effort, flow)
