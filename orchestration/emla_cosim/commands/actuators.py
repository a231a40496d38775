"""What a command shows of other actuators before it runs them: data sheet and model, and what to heed."""

from collections.abc import Sequence

from rich.markup import escape
from rich.table import Table

from ..scenarios.scenario import Scenario
from ..study.actuator.actuator import Actuator
from ..terminal import say, show


def show_before(scenario: Scenario) -> Sequence[str]:
    """Show the actuators of a scenario that has others, with its notes; the notes that were shown."""
    own = {joint: one for joint, one in scenario.options.actuator.items() if isinstance(one, Actuator)}
    for joint, one in own.items():
        table = Table(title=escape(f"{joint}: {one.name or one.file or 'actuator'}"), title_justify="left")
        for head in ("data sheet", "model"):
            table.add_column(head, overflow="fold")
        for found in one.conversions:
            if found.is_short:
                value = f"{found.value:.4g} {found.unit}".rstrip()
                table.add_row(escape(", ".join(found.entered)), escape(f"{found.becomes} = {value}"))
        show(table)
    if not own:
        return ()
    for note in scenario.notes:
        say(f"Note: {note}.")
    return scenario.notes
