"""Where a perturbation enters a system, and where its effect is read."""

from dataclasses import dataclass

from ...base.errors import CommandError, suggest_names
from ...master.instances.described_instance import DescribedInstance
from ...master.instances.integrated_instance import IntegratedInstance
from ...master.integrated_group import IntegratedGroup
from ...master.network import Network
from ...study.joint import current_reference, position_loop
from ...system.model import System


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
        nominal: Nominal value of the input, 1 if it has none.
        output: Position of the output in the signals; None to read the input itself.
    """

    instance: int
    input: int
    nominal: float
    output: int | None


def find_described(network: Network, component: str) -> tuple[DescribedInstance, int, dict[str, int]]:
    """Return the instance of a component in a network, alone or in a group that is integrated together.

    Returns:
        The instance of its own FMU, the position of the instance or group in the network, and the positions
        of its inputs in the vector of that, by name.
    """
    for i, instance in enumerate(network.instances):
        members = instance.members if isinstance(instance, IntegratedInstance) else [instance]
        for m, own in enumerate(members):
            if own.name == component:
                assert isinstance(own, DescribedInstance)
                ends = [(m, k) for k in range(len(own.read))]
                if isinstance(instance, IntegratedGroup):
                    ends = instance.free
                return own, i, {own.read[k].name: n for n, (at, k) in enumerate(ends) if at == m}
    raise ValueError(component)


def parse_opening(system: System, text: str) -> Place:
    """Return the place at which a text opens a loop.

    Args:
        system: The system.
        text: A connection `a.output->b.input`; a path inside of a component, `a.input->a.output`, on which
            the input is added to the output without delay; or a joint, for its measured position.

    Raises:
        CommandError: The text is none of these.
    """
    joints = _joints(system)
    if "->" not in text and text not in joints:
        hint = f", or a joint: {suggest_names(text, joints)}" if joints else "."
        raise CommandError(f"'{text}' is not a connection; write a.output->b.input{hint}", name=text)
    path = text if "->" in text else position_loop(text)
    source, _, target = (part.strip() for part in path.partition("->"))
    if not (source and target):
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


def default_openings(system: System) -> list[str]:
    """Return where loops are opened by default: at the current reference of each joint."""
    return [current_reference(joint) for joint in _joints(system)]


def _joints(system: System) -> list[str]:
    return [c.branch for c in system.components if c.name == f"{c.branch}.observer"]


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
    instance, position, inputs = find_described(network, component.name)
    read = {v.name: v for v in instance.read}
    own = component.alias(variable).variable
    if own not in read:
        raise CommandError(f"{place.input} is no input; {suggest_names(variable, read)}", name=place.input)
    if read[own].type != "Real":
        raise CommandError(
            f"{place.input} is {read[own].type}; a frequency response needs a Real.", name=place.input
        )
    if own not in inputs:
        raise CommandError(
            f"{place.input} is connected inside of components that are integrated together; set "
            "--no-together, or compute state matrices.",
            name=place.input,
        )
    at, nominal = (position, inputs[own]), abs(float(read[own].nominal or 1.0))
    if not place.output:
        return ResolvedPlace(*at, nominal, None)
    reached, variable = system.split(place.output)
    output = reached.alias(variable).variable
    full = f"{reached.name}.{output}"
    if full not in network.names:
        raise CommandError(
            f"{place.output} is no Real output; {suggest_names(place.output, network.names)}",
            name=place.output,
        )
    if place.is_loop and not instance.file.interface.direct.among({output}, own):
        raise CommandError(
            f"{place.output} does not depend on {place.input} without delay, so no loop can be opened there.",
            name=place.output,
        )
    return ResolvedPlace(*at, nominal, network.names.index(full))
