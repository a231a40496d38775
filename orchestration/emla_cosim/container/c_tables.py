"""The system as C: the tables of `shim/tables.h`, and those of the stepper."""

from collections.abc import Sequence
from typing import Any

from fmpy.model_description import ModelVariable

from fmublock.compiling import c_number, c_text

from ..base.errors import CommandError
from ..fmu.elements import BINARY, ElementVariable, is_clocked, position_in_array, value_type
from ..master.algorithms import newton
from ..master.instances.event_mode_instance import EventModeInstance
from ..master.instances.typed_values import allocate_array
from ..master.stepping.timing import MAXIMUM_STEPS
from ..stepper.layout import TRUTH_OF_FMI_2, TYPES
from .image import format_table
from .plan import ContainerPlan
from .variables import ContainerVariable, choose_time_name

_TEXT = TRUTH_OF_FMI_2 + 1
"""The number of the type of Strings; see `shim/tables.h`."""


def write_part_source(folder: str, source: str) -> str:
    """Return the C file that compiles one part in, with a prefix before its functions."""
    return f"""/* The part {folder}: its functions with a prefix. */
#include "fmi2Functions.h"
#undef fmi2FullName
#define fmi2FullName(name) {folder}_##name
fmi2FreeInstanceTYPE fmi2FreeInstance; /* which is called before it is defined */

#include "{folder}/{source}"
"""


class SystemTables:
    """The tables of a system for a version of FMI of the host.

    Args:
        plan: The system.
        identifier: The model identifier.
        variables: The variables of the FMU.
        fmi: The version of FMI.

    Attributes:
        sizes: the sizes of all tables, and the abilities of the system.
        header: the constant tables.
        wiring: the code that connects the tables of the stepper with the memory of an instance.

    Raises:
        CommandError: A start value is an integer that a double cannot hold.
    """

    def __init__(
        self, plan: ContainerPlan, identifier: str, variables: Sequence[ContainerVariable], fmi: int
    ) -> None:
        self._plan, self._image = plan, plan.image.image
        self._arrays = dict[tuple[int, int], int]()
        """Positions in `saved` of arrays, by component and value reference."""
        rows = [self._format_variable(v, fmi) for v in variables]
        if fmi == 3:  # which requires the time as a variable
            rows.append(f"{{{c_text(choose_time_name(variables))}, 'R', 0, 0, 0, -1, 0, 0, 1, -1, -1, -1}}")
        starts = [_format_start(i, x) for i, x in enumerate(variables) if x.is_overridden and x.is_settable]
        tables = [
            *self._list_libraries(),
            *self._list_parts(),
            *self._list_network(),
            *self._list_initial_groups(),
            *format_table("Variable", "variables", rows),
            *format_table("Start", "starts", starts),
            *self._list_text_links(),
        ]
        sizes = [1, *(v.size for v in variables)]
        lines = [f'#define MODEL_IDENTIFIER "{identifier}"', "#define GUID_SIZE 39", *self._list_flags()]
        lines += [
            f"#define {name} {value}" for name, value in self._list_numbers(variables, sizes, starts).items()
        ]
        lines += [f"#define {name} {c_number(value)}" for name, value in self._list_reals().items()]
        self.sizes = "\n".join([*lines, ""])
        self.header = "\n".join([*tables, *self._image.constants])
        self.wiring = self._image.text()

    def _list_flags(self) -> list[str]:
        """Return the lines that define the abilities of the system and the parts of the stepper in use."""
        plan = self._plan
        has_states = plan.all_can("canGetAndSetFMUstate")
        flags = {
            "HAS_STATE": has_states,
            # the standard allows serializing only with saved states
            "HAS_SERIALIZATION": has_states and plan.all_can("canSerializeFMUstate"),
            "HAS_FMI3_PARTS": any(library.fmi == 3 for library in plan.libraries),
        }
        parts = {
            "STEPPER_EVENTS": any(part.events >= 0 for part in plan.image.parts),
            "STEPPER_GROUPS": bool(plan.groups),
            "STEPPER_DIVISIONS": False,  # only loops divide steps in an exported FMU
            "STEPPER_WATCHED": False,  # a host has no reader of the present call and its time
        }
        lines = [f"#define {name} {int(value)}" for name, value in parts.items()]
        return [*lines, *(f"#define {name}" for name, value in flags.items() if value)]

    def _list_numbers(
        self, variables: Sequence[ContainerVariable], sizes: Sequence[int], starts: Sequence[str]
    ) -> dict[str, int]:
        """Return the sizes of the tables by their names in C."""
        plan, image, loops = self._plan, self._plan.image, self._plan.initial_groups
        return {
            "N_LIBRARIES": len(plan.libraries),
            "N_LOADED": sum(library.source is None for library in plan.libraries),
            "N_PARTS": len(plan.parts),
            "N_INPUTS": len(plan.network.inputs),
            "N_SIGNALS": len(plan.network.signals),
            "N_GROUPS": image.groups,
            "N_CALLS": image.image.pools["calls"],
            "N_CLOCKED_CALLS": image.image.pools["clocked_calls"],
            "N_EVENTS": sum(part.events >= 0 for part in image.parts),
            "N_STORES": image.stores,
            "N_RESTORED": image.restored,
            "N_JACOBIANS": len(image.jacobians),
            "N_SAVED": image.image.saved,
            "N_ROOM": image.image.room,
            "N_LOOPS": len(loops),
            "N_INITIAL": sum(len(loop.coupling) for loop in loops),
            "MOST_INITIAL": max((len(loop.coupling) for loop in loops), default=0),
            "N_VALUES": len(variables),
            "N_STARTS": len(starts),
            "MOST_SIZE": max(sizes),
            "N_TEXT_LINKS": len(plan.network.opaque_links),
            "LOOP_ITERATIONS": newton.ITERATIONS,
            "LOOP_HALVINGS": newton.HALVINGS,
        }

    def _list_reals(self) -> dict[str, float]:
        """Return the times and tolerances by their names in C."""
        times, clock = self._plan.times, self._plan.times.clock
        return {
            "START_TIME": times.start,
            "STEP_SIZE": times.step,
            "CLOCK_FIRST": clock.first,
            "CLOCK_PER_STEP": clock.per_step,
            "CLOCK_DENOMINATOR": clock.denominator,
            "MAXIMUM_STEPS": MAXIMUM_STEPS,
            "LOOP_TOLERANCE": newton.TOLERANCE,
            "LOOP_DIFFERENCE": newton.DIFFERENCE,
            "LOOP_ROUGH": newton.ROUGH,
        }

    def _list_libraries(self) -> list[str]:
        """Return the FMUs, and the functions of those that are compiled in."""
        plan, rows = self._plan, list[str]()
        has_states = plan.all_can("canGetAndSetFMUstate")
        has_bytes = has_states and plan.all_can("canSerializeFMUstate")
        # a loop repeats its steps even if the host cannot save states
        saved = {plan.parts[i].library for group in plan.groups if group.is_saved for i in group.members}
        handling = {p.library for p in plan.parts if isinstance(p.instance, EventModeInstance)}
        passing = {
            part.library
            for link in plan.network.opaque_links
            if link.input.type == BINARY
            for part in plan.parts
            if part.instance in (link.source, link.target)
        }
        for n, library in enumerate(plan.libraries):
            functions = f"{library.folder}_functions" if library.source else "NULL"
            file = "NULL" if library.source else c_text(library.file.model_identifier)
            guid = c_text(str(library.file.description.guid))
            needs = {
                "ALWAYS": True,
                "FOR_STATES": has_states or n in saved,
                "FOR_BYTES": has_bytes,
                "FOR_EVENTS": n in handling,
                "FOR_BINARY": n in passing,
            }
            reasons = " | ".join(name for name, value in needs.items() if value)
            rows.append(
                f"{{{guid}, {c_text(library.folder)}, {file}, {functions}, {library.fmi}, {reasons}}}"
            )
        compiled = [f"COMPILED_IN({library.folder})" for library in plan.libraries if library.source]
        return [*compiled, "", *format_table("Library", "libraries", rows)]

    def _list_parts(self) -> list[str]:
        """Return the table of the components, after the names of their clocks."""
        parts, rows = self._plan.image.parts, list[str]()
        names = [
            line
            for image in parts
            if image.events >= 0
            for line in format_table("char *const", f"clocks_{image.events}", map(c_text, image.clocks))
        ]
        for part, image in zip(self._plan.parts, parts, strict=True):
            options = part.instance.instantiation
            cells = [
                *(c_text(part.name), part.library, *image.setters, *image.getters),
                *(int(bool(options.get(name))) for name in ("eventModeUsed", "earlyReturnAllowed")),
                *(
                    image.events,
                    *image.event_state,
                    f"clocks_{image.events}" if image.events >= 0 else "NULL",
                ),
                c_number(part.instance.file.interface.tolerance or 0.0),
            ]
            rows.append(f"{{{', '.join(map(str, cells))}}}")
        return [*names, *format_table("Part", "parts", rows)]

    def _list_network(self) -> list[str]:
        """Return the tables of start values of inputs, names of signals, order and first Jacobians."""
        network, parts = self._plan.network, self._plan.parts
        starts = [c_number(float(x)) for part in parts for x in part.instance.input_starts]
        return [
            *format_table("double", "input_starts", starts),
            *format_table("char *const", "signal_names", map(c_text, network.names)),
            *format_table("int", "order", map(str, network.order)),
            *format_table("double", "first_jacobians", map(c_number, self._plan.image.jacobians)),
        ]

    def _list_initial_groups(self) -> list[str]:
        """Return the tables of the loops of initial values."""
        loops, rows, members, coupling = self._plan.initial_groups, list[str](), 0, 0
        for loop in loops:
            rows.append(f"{{{members}, {len(loop.members)}, {coupling}, {len(loop.coupling)}}}")
            members, coupling = members + len(loop.members), coupling + len(loop.coupling)
        return [
            *format_table("int", "initial_members", [str(i) for loop in loops for i in loop.members]),
            *format_table("int", "initial_coupling", [str(c) for loop in loops for c in loop.coupling]),
            *format_table("double", "initial_guesses", [c_number(x) for loop in loops for x in loop.guess]),
            *format_table("Loop", "loops", rows),
        ]

    def _list_text_links(self) -> list[str]:
        """Return the connections of Strings and Binary values."""
        rows, numbers = list[str](), {id(part.instance): i for i, part in enumerate(self._plan.parts)}
        for link in self._plan.network.opaque_links:
            names = (f"{link.source.name}.{link.output.name}", f"{link.target.name}.{link.input.name}")
            cells = [
                *(numbers[id(link.source)], numbers[id(link.target)]),
                *(link.output.valueReference, link.input.valueReference),
                *(int(link.input.type == BINARY), _choose_part_way(link.target, link.input)),
                *(getattr(link.input, "most_bytes", None) or 0, *map(c_text, names)),
            ]
            rows.append(f"{{{', '.join(map(str, cells))}}}")
        return format_table("TextLink", "text_links", rows)

    def _format_variable(self, variable: ContainerVariable, fmi: int) -> str:
        """Return the row of a variable in the table `variables`."""
        origin = variable.origin
        cells = [
            *(
                c_text(variable.name),
                f"'{variable.letter(fmi)}'",
                _find_type(origin),
                _choose_setting_time(variable),
            ),
            *(self._choose_way(variable), variable.part, origin.valueReference),
            *(position_in_array(origin), variable.size, self._save_values(variable), variable.signal),
            self._plan.image.parts[variable.part].ticks.get(str(origin.name), -1),
        ]
        return f"{{{', '.join(map(str, cells))}}}"

    def _save_values(self, variable: ContainerVariable) -> int:
        """Return the position in `saved` of its array, or of a value that waits or may cause an event.

        The memory is reserved on the first call; -1 if the variable needs none.
        """
        origin, part = variable.origin, self._plan.parts[variable.part]
        pending_inputs = self._plan.image.parts[variable.part].pending_inputs
        if origin.type == "String" or not variable.is_settable:
            return -1
        if str(origin.name) in pending_inputs:
            return self._image.save(pending_inputs[str(origin.name)])
        if not isinstance(origin, ElementVariable):
            return -1
        if variable.size == 1:  # FMI sets only longer arrays as a whole
            start = allocate_array(origin)
            return self._image.save(start, start) if self._choose_way(variable) == "IN_EVENT_MODE" else -1
        key = variable.part, int(origin.valueReference)
        if key not in self._arrays:
            start = allocate_array(origin)
            for x in start.tolist():
                _convert_exactly(f"{part.name}.{origin.name}", x)
            values = part.instance.arrays.setdefault(key[1], start)
            self._arrays[key] = self._image.save(values, start)
        return self._arrays[key]

    def _choose_way(self, variable: ContainerVariable) -> str:
        """Return how a part takes the value of a variable between its steps; see `shim/tables.h`."""
        if _choose_setting_time(variable) != "ALWAYS_SET":
            return "AT_ONCE"
        return _choose_part_way(self._plan.parts[variable.part].instance, variable.origin)


def _find_type(variable: ModelVariable) -> int:
    """Return the number in C of the type of a variable of a part."""
    if variable.type == "String":
        return _TEXT
    if variable.type == "Boolean" and not isinstance(variable, ElementVariable):
        return TRUTH_OF_FMI_2
    return TYPES.index(value_type(variable).name)


def _choose_part_way(instance: Any, variable: ModelVariable) -> str:
    """Return how a part takes the value of a variable between its steps; see `shim/tables.h`."""
    if not instance.instantiation.get("eventModeUsed") or variable.variability == "continuous":
        return "AT_ONCE"
    return "AT_TICKS" if is_clocked(variable) and variable.causality == "input" else "IN_EVENT_MODE"


def _choose_setting_time(variable: ContainerVariable) -> str:
    """Return when a host may set a variable; see `shim/tables.h`."""
    if not variable.is_settable:
        return "NEVER_SET"
    while_stepping = variable.causality == "input" or variable.variability == "tunable"
    return "ALWAYS_SET" if while_stepping else "SET_BEFORE_STEPS"


def _format_start(position: int, variable: ContainerVariable) -> str:
    if variable.origin.type == "String":
        return f"{{{position}, 0.0, {c_text(str(variable.start))}}}"
    value = variable.start
    number = {"true": 1, "false": 0}.get(value, value) if isinstance(value, str) else value
    return f"{{{position}, {c_number(_convert_exactly(variable.name, number))}, NULL}}"


def _convert_exactly(name: str, value: Any) -> float:
    """Return a value as a double; CommandError if it is an integer that a double cannot hold."""
    # all values of the host pass as doubles
    if isinstance(value, int) and int(float(value)) != value:
        raise CommandError(
            f"the start value {value} of {name} has too many digits: an FMU of a system holds integers up to "
            "2^53.",
            variable=name,
        )
    return float(value)
