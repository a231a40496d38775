"""`emla list`."""

from rich.table import Table

from ...base.toml_structs import read_toml
from ...fmu.models import MODELS
from ...run.options import list_options
from ...run.scenarios.scenario_file import PLANS, SCENARIOS, TUNINGS, find_built_in
from ...study.controllers import CONTROLLERS
from ...study.registration import register
from ...views.terminal import show

register()


def command() -> None:
    """Show tables of scenarios, plans, models, controllers and gain sets."""
    scenarios = Table(
        "scenario",
        "gains",
        "description",
        title="Scenarios: emla run SCENARIO, emla info SCENARIO",
        title_justify="left",
    )
    for name in SCENARIOS:
        scenario = find_built_in(name)
        scenarios.add_row(f"[bold]{name}[/]", str(scenario.options.get("gains") or ""), scenario.description)
    plans = []
    for title, texts in (("Sweeps: emla sweep PLAN", PLANS), ("Tunings: emla tune PLAN", TUNINGS)):
        plans.append(Table("plan", "description", title=title, title_justify="left"))
        for name, text in texts.items():
            plans[-1].add_row(f"[bold]{name}[/]", str(read_toml(text(), name).get("description", "")))
    models = Table("model", "description", title="Models: emla build MODEL", title_justify="left")
    for name, block in MODELS.items():
        models.add_row(f"[bold]{name}[/]", (block.__doc__ or "").strip().splitlines()[0])
    choices = Table("option", "choices", title="Choices", title_justify="left")
    for option in list_options().values():
        if option.choices is not None:
            choices.add_row(option.flag, ", ".join(map(str, option.choices())))
    choices.add_row("--controller", ", ".join(CONTROLLERS))
    for name, controller in CONTROLLERS.items():
        first, *other_gains = controller.gains
        choices.add_row(f"--gains, for {name}", ", ".join([f"{first} (recommended)", *other_gains]))
    for table in (scenarios, *plans, models, choices):
        show(table)
