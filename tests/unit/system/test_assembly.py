"""Systems assembled from FMU files, and messages for what does not match."""

from pathlib import Path

import pytest

from emla_cosim.base.errors import CommandError
from emla_cosim.fmu.models import fmu_path
from emla_cosim.master.assembly import Assembly
from emla_cosim.master.instances.fmu_instance import InstanceError
from emla_cosim.system.model import Component, Connection, System


def files(system: System, folder: Path) -> dict[str, Path]:
    return {c.name: fmu_path(c.model, "native", folder) for c in system.components}


def pair(connections: list[tuple[str, str]], folder: Path) -> tuple[System, dict[str, Path]]:
    """A plant, an observer and a reference with these connections, as 'component.variable' pairs."""
    components = (
        Component("j.plant", "EmlaPlant"),
        Component("j.observer", "EmlaObserver"),
        Component("j.reference", "Reference"),
    )
    links = []
    for source, target in connections:
        (a, output), (b, input_) = source.split(".", 1), target.split(".", 1)
        links.append(Connection(f"j.{a}", output, f"j.{b}", input_))
    system = System(components, tuple(links))
    return system, files(system, folder)


TWICE = [("plant.x_measured", "observer.y"), ("reference.x_d", "observer.y")]


@pytest.mark.parametrize(
    ("connections", "message"),
    [
        (TWICE, "observer.y is driven by two"),
        ([("plant.v_L", "observer.y")], "plant.v_L -> j.observer.y joins the units m/s and m"),
        ([("plant.motor.R_s", "observer.y")], "plant.motor.R_s must be an output"),
        ([("plant.x_measured", "observer.x_hat")], "observer.x_hat must be an input"),
        ([("plant.x_masured", "observer.y")], "plant has no variable 'x_masured'; did you mean x_measured"),
    ],
)
def test_invalid_connections(connections: list[tuple[str, str]], message: str, fmu_folder: Path) -> None:
    with pytest.raises(CommandError, match=message), Assembly(*pair(connections, fmu_folder)):
        pass


def test_logs_are_kept_per_instance(fmu_folder: Path) -> None:
    """fmpy knows one logger for the whole process; lines must still reach their own instance."""
    system, paths = pair([], fmu_folder)
    with Assembly(system, paths) as assembly:
        plant, observer, _ = assembly.network.instances
        for slave in (plant, observer):
            with pytest.raises(InstanceError) as failure:
                slave.do_step(0.0, 1.0)
            assert failure.value.fields["log"] == [f"{slave.name}: cannot do a step in phase instantiated."]
