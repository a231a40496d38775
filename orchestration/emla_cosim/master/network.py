"""Connected FMU instances: which signals each one reads, and a good order for stepping them."""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from heapq import heapify, heappop, heappush
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..base.arrays import Indices, Vector
from ..base.errors import CommandError, RunError, join_names
from .instances.fmu_instance import FmuInstance
from .observer import Observer

if TYPE_CHECKING:
    from fmpy.model_description import ModelVariable

    from .instances.described_instance import DescribedInstance


@dataclass(frozen=True)
class Link:
    """One output that drives one input: input = factor * output + offset.

    Attributes:
        source: position of the FMU instance with the output.
        output: position of the output in its vector.
        target: position of the FMU instance with the input.
        input: position of the input in its vector.
        direct: whether a connected output of the target depends on the input without delay.
        initial: the same for initial values.
        factor: in units of the input per unit of the output.
        offset: in the unit of the input.
        name: name in messages.
        through: positions of the connected outputs of the target that depend on the input without delay.
        shows: whether any output of the target, also an unconnected one, depends on it in this way.
    """

    source: int
    output: int
    target: int
    input: int
    direct: bool
    initial: bool = True
    factor: float = 1.0
    offset: float = 0.0
    name: str = ""
    through: tuple[int, ...] = ()
    shows: bool = False


class OpaqueLink(NamedTuple):
    """A String or Binary output that drives an input of the same type."""

    source: "DescribedInstance"
    output: "ModelVariable"
    target: "DescribedInstance"
    input: "ModelVariable"


class Network:
    """FMU instances, one vector of all their outputs, and the signals that each instance reads.

    The instance at position i writes its outputs to `signals[parts[i]]` and reads `signals[sources[i]]`. Its
    inputs, `inputs[input_parts[i]]`, are these signals times `factors[i]` plus `offsets[i]`.

    Attributes:
        instances: FMU instances.
        links: links between them.
        names: names of the signals.
        signals: all outputs, shape (signals,).
        inputs: all inputs, shape (inputs,).
        parts: slice of `signals` by position of the instance.
        input_parts: slice of `inputs` by position of the instance.
        sources: positions in `signals` that an instance reads.
        factors: factors of its inputs.
        offsets: offsets of its inputs.
        transforms: whether these change the values.
        read: positions of all signals that an instance reads.
        followers: positions of instances that only pass on the values of one source.
        order: positions in a good order of stepping one after the other.
        observer: reads the variables that recorders request besides the signals.
        opaque_links: connections of Strings and Binary values, which are not signals.
        tables: positions of instances whose signals are known in advance: data over time.
        samplers: positions of instances that compute at communication points only.
    """

    def __init__(
        self,
        instances: Sequence[FmuInstance],
        links: Sequence[Link],
        names: Sequence[str] = (),
        followers: Collection[int] = (),
    ) -> None:
        self.instances = list(instances)
        self.links = list(links)
        self.parts = _make_slices([len(s.outputs) for s in instances])
        self.input_parts = _make_slices([len(s.inputs) for s in instances])
        self.signals: Vector = np.zeros(sum(len(s.outputs) for s in instances))
        self.inputs: Vector = np.zeros(sum(len(s.inputs) for s in instances))
        self.use_signals(self.signals)
        self.names = list(names) or [f"{s.name}[{i}]" for s in instances for i in range(len(s.outputs))]
        self.sources: list[Indices] = [np.full(len(s.inputs), -1, dtype=np.intp) for s in instances]
        self.factors: list[Vector] = [np.ones(len(s.inputs)) for s in instances]
        # adding -0.0 changes no bit; adding 0.0 would turn a signal of -0.0 into 0.0
        self.offsets: list[Vector] = [np.full(len(s.inputs), -0.0) for s in instances]
        for link in links:
            i, j = link.target, link.input
            self.sources[i][j], self.factors[i][j] = self.signal(link), link.factor
            self.offsets[i][j] = link.offset or -0.0
        if any((s < 0).any() for s in self.sources):
            raise ValueError("every element of an instance's input vector needs a link")
        self.transforms = [
            bool((f != 1.0).any() or o.any()) for f, o in zip(self.factors, self.offsets, strict=True)
        ]
        self.read: Indices = np.unique(np.concatenate([np.empty(0, dtype=np.intp), *self.sources]))
        self.followers = frozenset(followers)
        self.observer = Observer({})
        self.opaque_links: list[OpaqueLink] = []
        self.tables: frozenset[int] = frozenset()
        self.samplers: frozenset[int] = frozenset()
        self._use_order(order_with_followers(len(instances), links, followers))

    def use_signals(self, storage: Vector) -> None:
        """Keep the signals in this memory, shape (signals,)."""
        self.signals = storage
        for instance, part, input_part in zip(self.instances, self.parts, self.input_parts, strict=True):
            instance.bind(self.inputs[input_part], storage[part])

    def _use_order(self, order: list[int]) -> None:
        """Use an order of stepping, and find the links that run against it."""
        self.order = order
        self._rank = {i: k for k, i in enumerate(order)}
        self._feedback_links: list[list[Link]] = [[] for _ in order]  # by target
        for link in self.find_feedback_links():
            self._feedback_links[link.target].append(link)

    def signal(self, link: Link) -> int:
        """Return the position in `signals` of the output that drives a link."""
        return int(self.parts[link.source].start) + link.output

    def pass_inputs(self, i: int) -> None:
        """Set the inputs of instance i to the present signals that it reads."""
        instance = self.instances[i]
        # NumPy buffers `out` in its default mode; the positions are valid
        self.signals.take(self.sources[i], out=instance.inputs, mode="clip")
        if self.transforms[i]:
            self.transform(i)
        instance.set_inputs()

    def pass_opaque_values(self) -> bool:
        """Pass the present Strings and Binary values on; return whether an input has changed.

        An input that has the value already is not set, because setting it may cause an event.

        Raises:
            RunError: A Binary value is larger than its input allows.
        """
        values = [link.source.value(link.output) for link in self.opaque_links]
        changed = False
        for link, value in zip(self.opaque_links, values, strict=True):
            if link.target.value(link.input) != value:
                limit = getattr(link.input, "most_bytes", None)
                if limit is not None and len(value) > limit:
                    raise RunError(
                        f"{link.source.name}.{link.output.name} has {len(value)} bytes, but "
                        f"{link.target.name}.{link.input.name} takes {limit} at the most (maxSize)."
                    )
                link.target.set_value(link.input, value)
                changed = True
        return changed

    def transform(self, i: int) -> None:
        """Apply factors and offsets to the signals that were copied into instance i's inputs."""
        inputs = self.instances[i].inputs
        inputs *= self.factors[i]
        inputs += self.offsets[i]

    def assume_inputs(self, i: int) -> None:
        """Set the signals that instance i reads so that they agree with its present inputs.

        A signal whose factor is 0 keeps its value.
        """
        offsets = self.offsets[i] + 0.0  # turns -0.0 into 0.0: -0.0 - -0.0 would be 0.0
        with np.errstate(all="ignore"):
            assumed = (self.instances[i].inputs - offsets) / self.factors[i]
        is_finite = np.isfinite(assumed)
        self.signals[self.sources[i][is_finite]] = assumed[is_finite]

    def reorder(self, names: Sequence[str]) -> None:
        """Replace the order of stepping.

        Args:
            names: Names of the instances or of their components. You can leave out instances without inputs,
                which then come first. You can also leave out all followers: each then comes after its source.

        Raises:
            CommandError: An instance is missing, unknown or named twice.
        """
        position = {instance.name: i for i, instance in enumerate(self.instances)}
        names = self._name_instances(names)
        listed = set(names)
        reads_nothing = (s.name for s in self.instances if not len(s.inputs) and s.name not in listed)
        names = [*reads_nothing, *names]
        leaders = {name for name, i in position.items() if i not in self.followers}
        if self.followers and sorted(names) == sorted(leaders):
            order = [position[name] for name in names]
            self._use_order(_insert_followers(order, self.links, self.followers))
            return
        if sorted(names) != sorted(position):
            missing = [n for n in position if n not in listed]
            invalid = [
                n or "''" for n in dict.fromkeys(names) if n not in position or list(names).count(n) > 1
            ]
            problems = [f"missing: {join_names(missing)}"] if missing else []
            problems += [f"unknown or named twice: {join_names(invalid)}"] if invalid else []
            raise CommandError(
                f"the order of stepping must name every component once ({'; '.join(problems)})."
            )
        self._use_order([position[n] for n in names])

    def _name_instances(self, names: Sequence[str]) -> list[str]:
        """Return the names with each run of components that one instance steps replaced by its name."""
        owner = {c: s.name for s in self.instances for c in s.components}
        instance_names: list[str] = []
        for name in names:
            if name == (instance := owner.get(name, name)) or instance not in instance_names:
                instance_names.append(instance)
        return instance_names

    def hold_back(self, last: Collection[int], keep_order: bool) -> None:
        """Move instances to the end of the order. The others only read their outputs from before the step.

        Args:
            last: Positions of these instances.
            keep_order: Whether the others keep their order. Otherwise they get one that is good without the
                links from `last`.
        """
        order = self.order
        if not keep_order:
            links = [link for link in self.links if link.source not in last or link.target in last]
            order = order_with_followers(len(self.instances), links, self.followers)
        self._use_order(sorted(order, key=lambda i: i in last))

    def find_feedback_links(self) -> list[Link]:
        """Return the links that run against `order`. In sequential stepping they are one step late."""
        rank = self._rank
        return [link for link in self.links if rank[link.source] >= rank[link.target]]

    def groups(self, counts: Callable[[Link], bool] = lambda link: True) -> list[list[int]]:
        """Return groups of instances that depend on each other; each group follows those it depends on.

        Args:
            counts: Whether to take a link into account.

        Returns:
            Positions of the instances of each group, in the order of the network. Instances in a loop of
            links share a group; all others are groups of their own.
        """
        links, rank = [x for x in self.links if counts(x)], self._rank
        # no link runs against the order, so there is no loop of several instances
        if all(rank[x.source] <= rank[x.target] for x in links):
            return [[i] for i in self.order]
        import networkx  # slow to import, and rarely needed

        graph = networkx.DiGraph([(x.source, x.target) for x in links])
        graph.add_nodes_from(self.order)
        condensed = networkx.condensation(graph)
        members = {c: sorted(condensed.nodes[c]["members"], key=rank.__getitem__) for c in condensed}
        order = networkx.lexicographical_topological_sort(condensed, lambda c: rank[members[c][0]])
        return [members[c] for c in order]

    def find_coupling_variables(
        self, group: Sequence[int], counts: Callable[[Link], bool] = lambda link: True
    ) -> Indices:
        """Return the positions of the signals of a group that are read before they are written."""
        inside = set(group)
        links = [x for i in inside for x in self._feedback_links[i] if x.source in inside and counts(x)]
        return np.array(sorted({self.signal(x) for x in links}), dtype=np.intp)

    def loops_without_delay(self) -> list[list[str]]:
        """Return the names of the signals of each loop without delay (algebraic loop)."""
        import networkx  # slow to import, and rarely needed

        graph = networkx.DiGraph(
            (self.signal(x), int(self.parts[x.target].start) + output)
            for x in self.links
            for output in x.through
        )
        loops = networkx.strongly_connected_components(graph)
        return [[self.names[s] for s in sorted(loop)] for loop in loops if len(loop) > 1]

    def loop_name(self, group: Sequence[int]) -> str:
        """Return a name for a loop of instances, such as `a -> b -> a`."""
        return " -> ".join(self.instances[i].name for i in [*group, group[0]])

    def find_nonfinite_signal(self, time: float) -> RunError | None:
        """Return an error that names the first signal that is read and not finite; None if all are finite."""
        # outputs that nothing reads may be NaN
        nonfinite = self.read[~np.isfinite(self.signals[self.read])]
        if not len(nonfinite):
            return None
        first = nonfinite[0]
        return RunError(f"{self.names[first]} became {self.signals[first]} at t = {time:.9g} s.")

    def check_finite(self, time: float) -> None:
        """Raise RunError if a signal that an instance reads is infinite or not a number; `time` in s."""
        if (failure := self.find_nonfinite_signal(time)) is not None:
            raise failure


def _make_slices(lengths: Sequence[int]) -> list[slice]:
    ends = np.cumsum([0, *lengths])
    return [slice(int(a), int(b)) for a, b in pairwise(ends)]


def order_with_followers(count: int, links: Sequence[Link], followers: Collection[int]) -> list[int]:
    """Return an order of stepping in which the followers do not change the order of the others.

    Each follower comes after its source, or first if it has none.
    """
    if not followers:
        return find_stepping_order(count, links)
    source_of = {link.target: link.source for link in links if link.target in followers}

    def find_origin(i: int) -> int | None:
        """Return the instance that drives i through followers: i itself if it is none; None without any."""
        while i in followers:
            if i not in source_of:
                return None
            i = source_of[i]
        return i

    direct = [
        replace(link, source=first)
        for link in links
        if link.target not in followers and (first := find_origin(link.source)) is not None
    ]
    leaders = [i for i in find_stepping_order(count, direct) if i not in followers]
    return _insert_followers(leaders, links, followers)


def _insert_followers(order: Sequence[int], links: Sequence[Link], followers: Collection[int]) -> list[int]:
    """Insert each follower after its source."""
    source_of = {link.target: link.source for link in links if link.target in followers}
    behind: dict[int | None, list[int]] = {}
    for i in sorted(followers):
        behind.setdefault(source_of.get(i), []).append(i)

    def list_chain(i: int | None) -> list[int]:
        head = [] if i is None else [i]
        return head + [k for follower in behind.get(i, []) for k in list_chain(follower)]

    return [k for i in (None, *order) for k in list_chain(i)]


def find_stepping_order(count: int, links: Sequence[Link]) -> list[int]:
    """Return the positions of the instances in an order in which most of them follow what they depend on.

    An instance whose connected outputs depend directly on an input comes after the input's source.
    Among the rest, the other links decide, then the order of declaration. In a loop of direct links,
    the instance that waits for the fewest sources comes first.
    """
    readers: list[dict[int, bool]] = [{} for _ in range(count)]  # of each source: whether directly
    for link in links:
        if link.source != link.target:
            was_direct = readers[link.source].get(link.target, False)
            readers[link.source][link.target] = was_direct or link.direct
    direct_waits, all_waits = [0] * count, [0] * count  # sources that each still waits for
    for targets in readers:
        for i, is_direct in targets.items():
            direct_waits[i] += is_direct
            all_waits[i] += 1
    waiting = set(range(count))
    queue = [(direct_waits[i], all_waits[i], i) for i in waiting]
    heapify(queue)
    order: list[int] = []
    while queue:
        instance = heappop(queue)[2]
        if instance not in waiting:  # an older entry of an instance that is in the order already
            continue
        waiting.remove(instance)
        order.append(instance)
        for i, is_direct in readers[instance].items():
            direct_waits[i] -= is_direct
            all_waits[i] -= 1
            if i in waiting:
                # the counts only fall, so the newest entry of an instance is its first
                heappush(queue, (direct_waits[i], all_waits[i], i))
    return order
