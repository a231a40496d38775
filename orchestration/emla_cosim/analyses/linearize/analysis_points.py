"""Analysis points: where a perturbation enters a system, and where its effect is read."""

from dataclasses import dataclass

from ...base.errors import CommandError, suggest_names
from ...master.instances.described_instance import DescribedInstance
from ...master.instances.integrated_instance import IntegratedInstance
from ...master.integrated_group import IntegratedGroup
from ...master.network import Network
from ...study.joint import name_current_path, name_position_loop
from ...system.model import System


@dataclass(frozen=True)
class AnalysisPoint:
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
class ResolvedPoint:
    """An analysis point as positions in a network.

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


def find_instance(network: Network, component: str) -> tuple[DescribedInstance, int, dict[str, int]]:
    """Return the instance of a component in a network, alone or in a group that is integrated together.

    Returns:
        The instance of its own FMU, the position of the instance or group in the network, and the positions
        of its inputs in the vector of that, by name.
    """
    for i, instance in enumerate(network.instances):
        members = instance.members if isinstance(instance, IntegratedInstance) else [instance]
        for m, member in enumerate(members):
            if member.name == component:
                assert isinstance(member, DescribedInstance)
                ends = [(m, k) for k in range(len(member.read))]
                if isinstance(instance, IntegratedGroup):
                    ends = instance.free
                return member, i, {member.read[k].name: n for n, (at, k) in enumerate(ends) if at == m}
    raise ValueError(component)


def parse_opening(system: System, text: str) -> AnalysisPoint:
    """Return the analysis point at which a text opens a loop.

    Args:
        system: The system.
        text: A connection `a.output->b.input`; a path inside of a component, `a.input->a.output`, on which
            the input is added to the output without delay; or a joint, for its measured position.

    Raises:
        CommandError: The text is none of these.
    """
    joints = _list_joints(system)
    if "->" not in text and text not in joints:
        hint = f", or a joint: {suggest_names(text, joints)}" if joints else "."
        raise CommandError(f"'{text}' is not a connection; write a.output->b.input{hint}", name=text)
    path = text if "->" in text else name_position_loop(text)
    source, _, target = (part.strip() for part in path.partition("->"))
    if not (source and target):
        raise CommandError(f"'{text}' is not a connection; write a.output->b.input.", name=text)
    (first, start), (second, end) = system.split(source), system.split(target)
    ends = (first.name, first.alias(start).variable), (second.name, second.alias(end).variable)
    driver = next((x for x in system.into(second.name) if x.ends[1] == ends[1]), None)
    label = f"{source} -> {target}"
    if driver is not None and driver.ends == ends:
        return AnalysisPoint(label, target, "", is_loop=True)
    if first.name == second.name:
        return AnalysisPoint(label, source, target, is_loop=True)
    if driver is not None:
        hint = f"{driver.source}.{driver.output} drives {target}."
    else:
        wires = [f"{x.source}.{x.output}->{x.target}.{x.input}" for x in system.connections]
        hint = suggest_names(f"{source}->{target}", wires, most=6) if wires else "nothing is connected."
    raise CommandError(f"there is no connection {label}: {hint}", name=text)


def choose_openings(system: System) -> list[str]:
    """Return where loops are opened by default: at the current reference of each joint."""
    return [name_current_path(joint) for joint in _list_joints(system)]


def _list_joints(system: System) -> list[str]:
    return [c.branch for c in system.components if c.name == f"{c.branch}.observer"]


def resolve_point(system: System, network: Network, point: AnalysisPoint) -> ResolvedPoint:
    """Return the positions of an analysis point.

    Args:
        system: The prepared system.
        network: Its network.
        point: The analysis point.

    Raises:
        CommandError: The input is not a connected input, or one of the signals does not exist or is not Real.
    """
    component, variable = system.split(point.input)
    instance, position, inputs = find_instance(network, component.name)
    read = {v.name: v for v in instance.read}
    input_name = component.alias(variable).variable
    if input_name not in read:
        hint = suggest_names(variable, read)
        raise CommandError(f"{point.input} is not an input; {hint}", name=point.input)
    if read[input_name].type != "Real":
        raise CommandError(
            f"{point.input} is {read[input_name].type}; a frequency response needs a Real.", name=point.input
        )
    if input_name not in inputs:
        raise CommandError(
            f"{point.input} is connected inside of components that are integrated together; set "
            "--no-together, or compute state matrices.",
            name=point.input,
        )
    at, nominal = (position, inputs[input_name]), abs(float(read[input_name].nominal or 1.0))
    if not point.output:
        return ResolvedPoint(*at, nominal, None)
    component_of_output, variable = system.split(point.output)
    output = component_of_output.alias(variable).variable
    output_name = f"{component_of_output.name}.{output}"
    if output_name not in network.names:
        raise CommandError(
            f"{point.output} is not a Real output; {suggest_names(point.output, network.names)}",
            name=point.output,
        )
    if point.is_loop and not instance.file.interface.direct.among({output}, input_name):
        raise CommandError(
            f"{point.output} does not depend on {point.input} without delay, so no loop can be opened there.",
            name=point.output,
        )
    return ResolvedPoint(*at, nominal, network.names.index(output_name))
