"""Show the actuators of a scenario before the run: data sheet, derived model and notes."""

from collections.abc import Sequence

from ...run.scenarios.scenario import Scenario
from ...study.actuator.actuator import Actuator
from ...views.terminal import print_line


def show_actuators(scenario: Scenario) -> Sequence[str]:
    """Show the non-default actuators of a scenario with their notes, and return these notes."""
    own = {joint: one for joint, one in scenario.options.actuator.items() if isinstance(one, Actuator)}
    for joint, one in own.items():
        print_line(f"{joint} has {one.title or one.label}:")
        for conversion in one.conversions:
            if conversion.is_short:
                print_line(f"  {conversion}")
    if not own:
        return ()
    for note in scenario.notes:
        print_line(f"Note: {note}.")
    return scenario.notes
