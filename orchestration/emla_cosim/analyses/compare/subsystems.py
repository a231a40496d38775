"""Split a prepared scenario into independent subsystems, so that none ends the run of another."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import networkx

from ...run.choices import resolve
from ...system.model import System
from ..execution.worker_payload import Preparation


def find_independent_subsystems(prepared: Preparation) -> list[Preparation]:
    """Return one subsystem for each joint, or for each group of joints that connections link."""
    graph = networkx.Graph()
    system = prepared.system
    branch = {c.name: c.branch for c in system.components}
    graph.add_nodes_from(branch.values())
    graph.add_edges_from((branch[x.source], branch[x.target]) for x in system.connections)
    found = list(networkx.connected_components(graph))
    if len(found) == 1:
        return [prepared]
    return [_make_subsystem(prepared, branches) for branches in found]


def _make_subsystem(prepared: Preparation, branches: set[str]) -> Preparation:
    system = prepared.system
    components = tuple(c for c in system.components if c.branch in branches)
    names = {c.name for c in components}
    others = {c.name for c in system.components} - names
    bonds = {name: bond for name, bond in system.bonds.items() if system.split(bond.effort)[0].name in names}
    fmus = {name: sha for name, sha in prepared.fmus.items() if name in names}
    options = prepared.options
    layers = [
        {name: _remove_components(value, others) for name, value in layer.items()}
        for layer in options.resolution.layers
    ]
    return replace(
        prepared,
        system=System(components, tuple(x for x in system.connections if x.source in names), bonds),
        options=replace(options, resolution=resolve(layers)),
        fmus=fmus,
        interfaces={name: one for name, one in prepared.interfaces.items() if name in names},
        files={sha: path for sha, path in prepared.files.items() if sha in fmus.values()},
    )


def _remove_components(value: Any, components: set[str]) -> Any:
    """Return the value of an option without the components that it names."""
    if isinstance(value, Mapping):
        return {name: one for name, one in value.items() if name not in components}
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [one for one in value if one not in components]
    return value
