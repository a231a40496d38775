"""Power bonds: an effort from one component to another, and the flow in the other direction."""

from dataclasses import dataclass

from ..base.errors import CommandError


@dataclass(frozen=True)
class Bond:
    """Two signals, by full name, whose product is a power, such as a force and a speed.

    One component outputs the effort; the other one receives it and returns the flow.
    """

    effort: str
    flow: str

    def __str__(self) -> str:
        return f"{self.effort} * {self.flow}"

    def with_names(self, **names: object) -> "Bond":
        """Return the bond with its placeholders, such as {joint}, replaced by these names."""
        return Bond(self.effort.format(**names), self.flow.format(**names))

    @classmethod
    def read(cls, name: str, text: str) -> "Bond":
        """Parse `EFFORT * FLOW`.

        Args:
            name: The name of the bond, for error messages.
            text: The text to parse.

        Raises:
            CommandError: If the text has another form.
        """
        effort, flow, *more = [part.strip() for part in text.split("*")] + [""]
        if not effort or not flow or any(more):
            raise CommandError(
                f"the bond {name} is '{text}'; write two signals, such as 'load.F * actuator.v'.", bond=name
            )
        return cls(effort, flow)
