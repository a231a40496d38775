"""Where a perturbation enters a system, and where its effect is read."""

from dataclasses import dataclass

from ..base.errors import CommandError, suggest_names
from ..master.instances.described_instance import DescribedInstance
from ..master.network import Network
from ..study.joint import position_loop
from ..system.model import System


@dataclass(frozen=True)
class Place:
    """A pair of signals whose frequency response is measured.

    Attributes:
        label: Name in tables and pictures.
        input: Full name of the input to perturb.
        output: Full name of the output to read; empty to read the input itself, with what drives it.
        is_loop: Whether a loop is opened here.
    """

    label: str
    input: str
    output: str
    is_loop: bool = False


@dataclass(frozen=True)
class ResolvedPlace:
    """A place as positions in a network.

    Attributes:
        instance: Position of the FMU instance with the input.
        input: Position of the input in its vector.
        output: Position of the output in the signals; None to read the input itself.
    """

    instance: int
    input: int
    output: int | None


def parse_opening(system: System, text: str) -> Place:
    """Return the place at which a text opens a loop.

    Args:
        system: The system.
        text: A connection `a.output->b.input`; a path inside of a component, `a.input->a.output`, on which
            the input is added to the output without delay; or a joint, for its measured position.

    Raises:
        CommandError: The text is none of these.
    """
    source, arrow, target = (part.strip() for part in _of_joint(system, text).partition("->"))
    if not (source and arrow and target):
        raise CommandError(f"'{text}' is not a connection; write a.output->b.input.", name=text)
    (first, start), (second, end) = system.split(source), system.split(target)
    ends = (first.name, first.alias(start).variable), (second.name, second.alias(end).variable)
    driver = next((x for x in system.into(second.name) if x.ends[1] == ends[1]), None)
    label = f"{source} -> {target}"
    if driver is not None and driver.ends == ends:
        return Place(label, target, "", is_loop=True)
    if first.name == second.name:
        return Place(label, source, target, is_loop=True)
    if driver is not None:
        now = f"{driver.source}.{driver.output} drives {target}."
    else:
        wires = [f"{x.source}.{x.output}->{x.target}.{x.input}" for x in system.connections]
        now = suggest_names(f"{source}->{target}", wires, most=6) if wires else "nothing is connected."
    raise CommandError(f"there is no connection {label}: {now}", name=text)


def _of_joint(system: System, text: str) -> str:
    if "->" in text:
        return text
    joints = [c.branch for c in system.components if c.name == f"{c.branch}.observer"]
    if text not in joints:
        known = f", or a joint: {suggest_names(text, joints)}" if joints else "."
        raise CommandError(f"'{text}' is not a connection; write a.output->b.input{known}", name=text)
    return position_loop(text)


def resolve_place(system: System, network: Network, place: Place) -> ResolvedPlace:
    """Return the positions of a place.

    Args:
        system: The prepared system.
        network: Its network.
        place: The place.

    Raises:
        CommandError: The input is no connected input, one of the signals does not exist, or is not Real.
    """
    component, variable = system.split(place.input)
    names = [instance.name for instance in network.instances]
    i = names.index(component.name)
    instance = network.instances[i]
    assert isinstance(instance, DescribedInstance)
    read = [v.name for v in instance.read]
    own = component.alias(variable).variable
    if own not in read:
        raise CommandError(f"{place.input} is no input; {suggest_names(variable, read)}", name=place.input)
    j = read.index(own)
    if instance.read[j].type != "Real":
        raise CommandError(
            f"{place.input} is {instance.read[j].type}; a frequency response needs a Real.", name=place.input
        )
    if not place.output:
        return ResolvedPlace(i, j, None)
    if place.output not in network.names:
        raise CommandError(
            f"{place.output} is no Real output; {suggest_names(place.output, network.names)}",
            name=place.output,
        )
    reached, variable = system.split(place.output)
    output = reached.alias(variable).variable
    if place.is_loop and not instance.file.interface.direct.among({output}, own):
        raise CommandError(
            f"{place.output} does not depend on {place.input} without delay, so no loop can be opened there.",
            name=place.output,
        )
    return ResolvedPlace(i, j, network.names.index(place.output))
