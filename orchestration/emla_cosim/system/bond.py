"""Power bonds: an effort from one component to another, and the flow in the other direction."""

from dataclasses import dataclass

from ..base.errors import CommandError


@dataclass(frozen=True)
class Bond:
    """Two signals whose product is a power, such as a force and a speed.

    One component sends the effort to another one, which sends back the flow.

    Args:
        effort: full name of the first signal.
        flow: full name of the second signal.

    Examples:
        >>> import emla_cosim as ec
        >>> ec.Bond.read("axis", "load.F * actuator.v")
        Bond(effort='load.F', flow='actuator.v')
    """

    effort: str
    flow: str

    def __str__(self) -> str:
        return f"{self.effort} * {self.flow}"

    def with_names(self, **names: object) -> "Bond":
        """Return the bond with names instead of placeholders such as {joint}."""
        return Bond(self.effort.format(**names), self.flow.format(**names))

    @classmethod
    def read(cls, name: str, text: str) -> "Bond":
        """Read a bond from the text EFFORT * FLOW.

        Args:
            name: name of the bond in error messages.
            text: names of two signals.

        Raises:
            CommandError: the text cannot be read.
        """
        # one more part, so that a text without `*` has an empty flow
        effort, flow, *more = [part.strip() for part in text.split("*")] + [""]
        if not effort or not flow or any(more):
            raise CommandError(
                f"the bond {name} is '{text}'; write two signals, such as 'load.F * actuator.v'.", bond=name
            )
        return cls(effort, flow)
