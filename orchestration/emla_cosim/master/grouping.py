"""Find components that are integrated together, and connect all components."""

from collections.abc import Collection, Container, Mapping, Sequence
from dataclasses import dataclass, replace

from ..fmu.file import FmuFile
from ..fmu.interface import MODEL_EXCHANGE, Interface
from ..system.model import System
from .instances.fmu_instance import FmuInstance
from .instances.instance_kinds import make_stepped
from .instances.integrated_instance import ModelExchangeInstance
from .integrated_group import IntegratedGroup
from .network import Link, Network


def find_groups(
    system: System,
    interfaces: Mapping[str, Interface],
    kinds: Mapping[str, str],
    isolated: Container[str] = (),
) -> list[list[str]]:
    """Return the components that are integrated together, by name: one list for each group.

    These run as Model Exchange, and continuous connections join them. A component that samples or is isolated
    has an integrator of its own.

    Args:
        system: The system.
        interfaces: Model description of every component.
        kinds: Kind as which every component runs.
        isolated: Names of the components that run in processes of their own.
    """
    groupable = {
        c.name
        for c in system.components
        if kinds[c.name] == MODEL_EXCHANGE and not c.samples and c.name not in isolated
    }
    group_of: dict[str, list[str]] = {}
    for x in system.connections:
        ends = [interfaces[name].variables[variable] for name, variable in x.ends]
        if {x.source, x.target} <= groupable and all(v.variability == "continuous" for v in ends):
            merged = {*group_of.get(x.source, [x.source]), *group_of.get(x.target, [x.target])}
            group = [c.name for c in system.components if c.name in merged]
            group_of |= dict.fromkeys(group, group)
    return [group_of[c.name] for c in system.components if c.name == group_of.get(c.name, [""])[0]]


def arrange(components: Sequence[str], groups: Sequence[list[str]]) -> list[list[str]]:
    """Return all components in groups, by name; each group has the position of its first component."""
    first = {group[0]: group for group in groups}
    later_members = {name for group in groups for name in group[1:]}
    return [first.get(name, [name]) for name in components if name not in later_members]


def connect(
    instances: Mapping[str, FmuInstance],
    arranged: Sequence[Sequence[str]],
    groups: Collection[Sequence[str]],
    links: Sequence[Link],
    names: Sequence[str],
    followers: Collection[int],
) -> Network:
    """Connect instances, of which those in a group are one instance of the network.

    Args:
        instances: Instances by component.
        arranged: All components in their groups.
        groups: The groups that are integrated together.
        links: Links between the components, with positions in `instances`.
        names: Names of all outputs, in the order of `arranged`.
        followers: Positions of components that only pass on the values of one source.
    """
    position = {name: i for i, name in enumerate(instances)}
    positions = {position[n]: (u, i) for u, names_ in enumerate(arranged) for i, n in enumerate(names_)}
    all_instances = list(instances.values())
    joined = {u for u, members in enumerate(arranged) if members in groups}
    inside: dict[int, list[Link]] = {u: [] for u in joined}
    outside = []
    for x in links:
        (u, i), (v, k) = positions[x.source], positions[x.target]
        source, target = (all_instances[end] for end in (x.source, x.target))
        # a discrete input samples at communication points, so this link stays outside of the group
        sampled = source.continuous_outputs[x.output] and not target.continuous_inputs[x.input]
        if u == v and u in joined and not sampled:
            inside[u].append(replace(x, source=i, target=k))
        else:
            outside.append(x)
    stepped: list[FmuInstance] = []
    for u, members in enumerate(arranged):
        steppers = [instances[n] for n in members]
        models = [s for s in steppers if isinstance(s, ModelExchangeInstance)]
        stepped.append(IntegratedGroup(models, inside[u]) if u in joined else make_stepped(steppers[0]))
    condensed = [_make_network_link(x, positions, stepped) for x in outside]
    return Network(stepped, _correct_direct(condensed, stepped), names, [positions[i][0] for i in followers])


def _make_network_link(
    link: Link, positions: Mapping[int, tuple[int, int]], stepped: Sequence[FmuInstance]
) -> Link:
    """Return a link between components as one between the instances of the network."""
    (u, i), (v, k) = positions[link.source], positions[link.target]
    source, target = stepped[u], stepped[v]
    if isinstance(source, IntegratedGroup):
        link = replace(link, output=source.position(i, link.output))
    if isinstance(target, IntegratedGroup):
        through = tuple(sorted(target.find_direct_outputs(k, link.through)))
        link = replace(link, input=target.free.index((k, link.input)), through=through)
    return replace(link, source=u, target=v)


def _correct_direct(links: Sequence[Link], stepped: Sequence[FmuInstance]) -> list[Link]:
    """Return the links; one into a group is direct only if an output that is used outside depends on it."""
    used = {(x.source, x.output) for x in links}
    return [
        replace(x, direct=any((x.target, k) in used for k in x.through))
        if isinstance(stepped[x.target], IntegratedGroup)
        else x
        for x in links
    ]


@dataclass(frozen=True)
class Sampling:
    """Which components sample, by name.

    Attributes:
        samplers: Components that compute at communication points, such as digital controllers.
        unknown: Components that do not show whether they do.
    """

    samplers: frozenset[str]
    unknown: frozenset[str]


def find_sampling(files: Mapping[str, FmuFile], declared: Collection[str]) -> Sampling:
    """Return which components sample.

    Args:
        files: The FMU of each component.
        declared: Components that are declared to sample.
    """
    samples_by_name = {name: True if name in declared else _is_sampling(file) for name, file in files.items()}
    samplers, unknown = (
        frozenset(n for n, s in samples_by_name.items() if s is kind) for kind in (True, None)
    )
    return Sampling(samplers, unknown)


def _is_sampling(file: FmuFile) -> bool | None:
    """Return whether an FMU samples; None if its description does not show it."""
    # our FMUs have their discrete states as discrete local variables
    causalities = ("local",) if file.is_ours else ("local", "output", "independent")
    variables = [v for v in file.variables.values() if v.causality in causalities]
    if file.interface.clocks or any(v.variability == "discrete" for v in variables):
        return True
    return False if file.is_ours or file.description.derivatives else None
