"""The system as C: the tables of `shim/tables.h`, and the functions of the parts."""

from collections.abc import Iterable, Sequence
from typing import Any

from fmpy.model_description import ModelVariable

from fmublock.compiling import c_number

from ..base.errors import CommandError
from ..fmu.elements import ElementVariable, place_in_array
from ..master.algorithms import group, newton, quasi_newton
from ..master.instances.described_instance import DescribedInstance
from ..master.instances.typed_values import PlannedCall, plan_calls
from ..master.stepping.timing import MAXIMUM_STEPS
from .plan import ContainerPlan, Group
from .variables import ContainerVariable, own_letter, time_name

FUNCTIONS = (
    *("Instantiate", "FreeInstance", "SetupExperiment", "EnterInitializationMode"),
    *("ExitInitializationMode", "Terminate"),
    *("GetReal", "GetInteger", "GetBoolean", "GetString"),
    *("SetReal", "SetInteger", "SetBoolean", "SetString"),
    *("SetRealInputDerivatives", "DoStep", "GetBooleanStatus"),
)
"""Functions of a part that the FMU calls."""

STATE_FUNCTIONS = ("GetFMUstate", "SetFMUstate", "FreeFMUstate")
BYTE_FUNCTIONS = ("SerializedFMUstateSize", "SerializeFMUstate", "DeSerializeFMUstate")

_OTHERS = (
    *("GetTypesPlatform", "GetVersion", "SetDebugLogging", "Reset", "GetDirectionalDerivative"),
    *("GetRealOutputDerivatives", "CancelStep", "GetStatus", "GetRealStatus", "GetIntegerStatus"),
    *("GetStringStatus", "EnterEventMode", "NewDiscreteStates", "EnterContinuousTimeMode"),
    *("CompletedIntegratorStep", "SetTime", "SetContinuousStates", "GetDerivatives", "GetEventIndicators"),
    *("GetContinuousStates", "GetNominalsOfContinuousStates"),
)
"""Further functions of the standard, which a part that is compiled in has, too."""


def functions_header(plan: ContainerPlan) -> str:
    """Return the table of functions, and that of each FMU that is compiled in."""
    states = plan.all_can("canGetAndSetFMUstate")
    has = {"HAS_STATE": states, "HAS_SERIALIZATION": states and plan.all_can("canSerializeFMUstate")}
    needed = [*FUNCTIONS, *(STATE_FUNCTIONS if states or any(part.saved for part in plan.parts) else ())]
    needed += BYTE_FUNCTIONS if has["HAS_SERIALIZATION"] else ()
    names = (*FUNCTIONS, *STATE_FUNCTIONS, *BYTE_FUNCTIONS)
    lines = ["/* The functions of a part. Libraries may lack those that are not needed. */"]
    lines += [f"#define {name}" for name, is_so in has.items() if is_so]
    lines += ["", *_list("FUNCTIONS", names), *_list("NEEDED", needed)]
    fields = ["    FUNCTIONS(DECLARE)"]
    if any(library.fmi == 3 for library in plan.libraries):
        groups = {"ALWAYS": FUNCTIONS, "STATE": STATE_FUNCTIONS, "BYTES": BYTE_FUNCTIONS}
        shared = [f"SHARED_{name}(X)" for name, group in groups.items() if group[0] in needed]
        lines += ["#define HAS_FMI3_PARTS", '#include "fmi3FunctionTypes.h"', '#include "part_functions.h"']
        lines += [f"#define SHARED_NEEDED(X) {' '.join(shared)}", ""]
        fields += ["    Functions3 three;"]
    lines += [
        "#define DECLARE(name) fmi2##name##TYPE *name;",
        "typedef struct {",
        *fields,
        "} Functions;",
        "",
    ]
    for library in (x for x in plan.libraries if x.source):
        prefix = _prefix(library.folder)
        lines += [f"fmi2{name}TYPE {prefix}fmi2{name};" for name in names]
        values = ", ".join(f".{name} = {prefix}fmi2{name}" for name in names)
        lines += [f"static const Functions {prefix}functions = {{{values}}};", ""]
    return "\n".join(lines)


def _list(name: str, functions: Sequence[str]) -> list[str]:
    """Return a macro that applies another one to each function."""
    inner = [f"    X({function}) \\" for function in functions[:-1]]
    return [f"#define {name}(X) \\", *inner, f"    X({functions[-1]})", ""]


def _prefix(folder: str) -> str:
    return f"{folder}_"


def part_source(folder: str, source: str) -> str:
    """Return the C file that compiles one part in, with a prefix before its functions."""
    prefix = _prefix(folder)
    lines = [f"/* The part {folder}: its functions with a prefix. */", '#include "fmi2Functions.h"', ""]
    for name in (*FUNCTIONS, *STATE_FUNCTIONS, *BYTE_FUNCTIONS, *_OTHERS):
        lines += [
            f"#undef fmi2{name}",
            f"#define fmi2{name} {prefix}fmi2{name}",
            f"fmi2{name}TYPE fmi2{name};",
        ]
    return "\n".join([*lines, "", f'#include "{folder}/{source}"', ""])


def system_header(
    plan: ContainerPlan, identifier: str, variables: Sequence[ContainerVariable], fmi: int
) -> str:
    """Return the tables of a system for a version of FMI."""
    network, parts, groups, loops = plan.network, plan.parts, plan.groups, plan.initial_groups
    clock = plan.times.clock
    reads = [v for part in parts for v in part.instance.read]
    writes = [v for part in parts for v in part.instance.written]
    coupling = [c for g in groups for c in g.coupling]
    initial_coupling = [c for g in loops for c in g.coupling]
    starts = [(v, x) for v, x in enumerate(variables) if x.changed and x.settable]
    arrays = _Arrays(plan, variables)
    calls = _Calls(plan, arrays)
    values = [*calls.sizes, *(v.size for v in variables), len(reads), len(writes)]
    numbers = {
        "N_LIBRARIES": len(plan.libraries),
        "N_LOADED": sum(library.source is None for library in plan.libraries),
        "N_PARTS": len(parts),
        "N_INPUTS": len(reads),
        "N_SIGNALS": len(writes),
        "N_READ": len(network.read),
        "N_OPERATIONS": len(plan.operations),
        "N_GROUPS": len(groups),
        "N_JACOBIANS": sum(len(g.values) for g in groups),
        "N_INITIAL_GROUPS": len(loops),
        "N_INITIAL": len(initial_coupling),
        "N_VALUES": len(variables),
        "N_STARTS": len(starts),
        "N_ELEMENTS": len(arrays.starts),
        "MOST_VALUES": max(values, default=0),
        "MOST_INPUTS": max((len(p.instance.read) for p in parts), default=0),
        "MOST_OUTPUTS": max((len(p.instance.written) for p in parts), default=0),
        "MOST_COUPLING": max((len(g.coupling) for g in groups), default=0),
        "MOST_INITIAL": max((len(g.coupling) for g in loops), default=0),
        "SWEEPS": group.SWEEPS,
        "HALVINGS": group.HALVINGS,
        "LOOP_ITERATIONS": newton.ITERATIONS,
        "LOOP_HALVINGS": newton.HALVINGS,
    }
    reals = {
        "START_TIME": plan.times.start,
        "STEP_SIZE": plan.times.step,
        "CLOCK_FIRST": clock.first,
        "CLOCK_PER_STEP": clock.per_step,
        "CLOCK_DENOMINATOR": clock.denominator,
        "COUPLING_TOLERANCE": plan.coupling_tolerance,
        "MAXIMUM_STEPS": MAXIMUM_STEPS,
        "RELAXATION": quasi_newton.RELAXATION,
        "NOISE": quasi_newton.NOISE,
        "FILTER": quasi_newton.FILTER,
        "LOOP_TOLERANCE": newton.TOLERANCE,
        "LOOP_DIFFERENCE": newton.DIFFERENCE,
        "LOOP_ROUGH": newton.ROUGH,
    }
    orders = ", ".join("1" for _ in range(max(numbers["MOST_INPUTS"], 1)))
    lines = [f'#define MODEL_IDENTIFIER "{identifier}"', "#define GUID_SIZE 39"]
    lines += [f"#define {name} {value}" for name, value in numbers.items()]
    lines += [f"#define {name} {c_number(value)}" for name, value in reals.items()]
    lines += [f"#define FIRST_ORDERS {{{orders}}}", ""]
    lines += _libraries(plan) + _parts(plan, calls)
    lines += _table("Input", "inputs", _inputs(plan))
    lines += _table("fmi2ValueReference", "input_references", [str(v.valueReference) for v in reads])
    lines += _table("Signal", "signals", _signals(plan))
    lines += _table("fmi2ValueReference", "output_references", [str(v.valueReference) for v in writes])
    lines += calls.tables()
    lines += _table("double", "first_elements", map(c_number, arrays.starts))
    lines += _table("int", "read_signals", map(str, network.read))
    lines += _table("int", "order", map(str, network.order))
    does = ("SET_INPUTS", "STEP_PART", "GET_OUTPUTS")
    lines += _table("Operation", "operations", [f"{{{does[o.call]}, {o.instance}}}" for o in plan.operations])
    lines += _table("int", "members", [str(i) for g in groups for i in g.members])
    lines += _table("int", "coupling", map(str, coupling))
    lines += _table("Group", "groups", _groups(groups))
    lines += _table("double", "first_jacobians", [c_number(x) for g in groups for x in g.values])
    lines += _table("int", "initial_members", [str(i) for g in loops for i in g.members])
    lines += _table("int", "initial_coupling", map(str, initial_coupling))
    lines += _table("Group", "initial_groups", _groups(loops))
    lines += _table("double", "initial_guesses", [c_number(x) for g in loops for x in g.values])
    rows = [
        f"{{{_text(v.name)}, '{v.letter(fmi)}', '{own_letter(v.own)}', {_settable(v)}, {v.part}, "
        f"{v.own.valueReference}, {place_in_array(v.own)}, {v.size}, {arrays.place(v.part, v.own)}, "
        f"{v.signal}}}"
        for v in variables
    ]
    if fmi == 3:
        rows.append(f"{{{_text(time_name(variables))}, 'R', 'R', 0, -1, 0, 0, 1, -1, -1}}")
    lines += _table("Variable", "variables", rows)
    lines += _table("Start", "starts", [_start(v, x) for v, x in starts])
    return "\n".join(lines)


def _settable(variable: ContainerVariable) -> int:
    """Return when a host may set a variable; see shim/tables.h."""
    if not variable.settable:
        return 0
    while_stepping = variable.causality == "input" or variable.variability == "tunable"
    return 1 if while_stepping else 2


class _Arrays:
    """The arrays of which elements are set, and their start values: an array is set as a whole.

    Raises:
        CommandError: A start value is an integer that a double cannot hold.
    """

    def __init__(self, plan: ContainerPlan, variables: Sequence[ContainerVariable]) -> None:
        self.starts = list[float]()
        self._places: dict[tuple[int, int], int] = {}
        for i, part in enumerate(plan.parts):
            own = [*part.instance.read, *(v.own for v in variables if v.part == i and v.settable)]
            for variable in own:
                key = i, int(variable.valueReference)
                if isinstance(variable, ElementVariable) and variable.size > 1 and key not in self._places:
                    self._places[key] = len(self.starts)
                    self.starts += (_exact(f"{part.name}.{variable.name}", x) for x in variable.array_start)

    def place(self, part: int, variable: ModelVariable) -> int:
        """Return the place of a variable's array; -1 if it has none."""
        return self._places.get((part, int(variable.valueReference)), -1)


class _Calls:
    """The calls that set the inputs and get the signals of the parts."""

    def __init__(self, plan: ContainerPlan, arrays: _Arrays) -> None:
        self._rows, self._references = list[str](), list[int]()
        self._items, self._places = list[int](), list[int]()
        self.sizes = list[int]()
        """Numbers of values of the calls."""
        self.ranges = list[tuple[int, int, int, int]]()
        """For each part, position and number of the calls that set, and of those that get."""
        for i, part in enumerate(plan.parts):
            places = (plan.network.input_parts[i].start, plan.network.parts[i].start)
            counts = list[int]()
            for access, variables, first in zip(
                ("set", "get"), (part.instance.read, part.instance.written), places, strict=True
            ):
                begin = len(self._rows)
                for call in plan_calls(access, variables):
                    memory = arrays.place(i, variables[call.members[0]]) if access == "set" else -1
                    self._add(call, own_letter(variables[call.members[0]]), first, memory)
                counts += [begin, len(self._rows) - begin]
            self.ranges.append((counts[0], counts[1], counts[2], counts[3]))

    def _add(self, call: PlannedCall, letter: str, first: int, memory: int) -> None:
        cells = (len(self._references), len(call.references), len(self._items), len(call.members))
        self._rows.append(f"{{'{letter}', {', '.join(map(str, cells))}, {call.size}, {memory}}}")
        self._references += call.references.tolist()
        self._items += [first + m for m in call.members]
        self._places += call.places.tolist()
        self.sizes.append(call.size)

    def tables(self) -> list[str]:
        """Return the tables in C."""
        return [
            *_table("Call", "calls", self._rows),
            *_table("fmi2ValueReference", "call_references", map(str, self._references)),
            *_table("int", "call_items", map(str, self._items)),
            *_table("int", "call_places", map(str, self._places)),
        ]


def _libraries(plan: ContainerPlan) -> list[str]:
    rows = []
    for library in plan.libraries:
        functions = f"&{_prefix(library.folder)}functions" if library.source else "NULL"
        file = "NULL" if library.source else _text(library.file.model_identifier)
        guid = _text(str(library.file.description.guid))
        rows.append(f"{{{guid}, {_text(library.folder)}, {file}, {functions}, {library.fmi}}}")
    return _table("Library", "libraries", rows)


def _parts(plan: ContainerPlan, calls: _Calls) -> list[str]:
    rows = []
    modes = ("HOLD", "MIDDLE", "LINE")
    for i, part in enumerate(plan.parts):
        taken, written = plan.network.input_parts[i], plan.network.parts[i]
        tolerance = part.instance.file.interface.tolerance or 0.0
        cells: list[Any] = [
            *(_text(part.name), part.library, taken.start, taken.stop - taken.start),
            *(written.start, written.stop - written.start, *calls.ranges[i]),
            *(
                modes[part.mode],
                part.multiple,
                int(part.rare),
                int(_is_typed(part.instance)),
                int(part.saved),
            ),
            c_number(tolerance),
        ]
        rows.append(f"{{{', '.join(map(str, cells))}}}")
    return _table("Part", "parts", rows)


def _is_typed(instance: DescribedInstance) -> bool:
    """Return whether an instance exchanges other types than doubles, or arrays."""
    has_arrays = any(
        isinstance(v, ElementVariable) and v.size > 1 for v in (*instance.read, *instance.written)
    )
    return instance.typed or has_arrays


def _inputs(plan: ContainerPlan) -> list[str]:
    network, rows = plan.network, []
    for i, part in enumerate(plan.parts):
        for j in range(len(part.instance.read)):
            signal = int(network.sources[i][j])
            moves = plan.smooth[signal] and bool(part.instance.continuous_inputs[j])
            start = part.instance.input_starts[j]
            numbers = (network.factors[i][j], network.offsets[i][j], start)
            rows.append(f"{{{signal}, {int(moves)}, {', '.join(c_number(float(x)) for x in numbers)}}}")
    return rows


def _signals(plan: ContainerPlan) -> list[str]:
    rows = []
    for i, part in enumerate(plan.parts):
        first = plan.network.parts[i].start
        for s in range(first, first + len(part.instance.written)):
            floor, name = c_number(float(plan.floors[s])), _text(plan.network.names[s])
            rows.append(f"{{{i}, {int(plan.smooth[s])}, {floor}, {name}}}")
    return rows


def _groups(groups: Iterable[Group]) -> list[str]:
    rows, members, coupling, values = [], 0, 0, 0
    for g in groups:
        rows.append(
            f"{{{members}, {len(g.members)}, {coupling}, {len(g.coupling)}, {values}, {int(g.saved)}, "
            f"{int(g.halves)}}}"
        )
        members, coupling = members + len(g.members), coupling + len(g.coupling)
        values += len(g.values)
    return rows


def _start(place: int, variable: ContainerVariable) -> str:
    if variable.own.type == "String":
        return f"{{{place}, 0.0, {_text(str(variable.start))}}}"
    value = variable.start
    number = {"true": 1, "false": 0}.get(value, value) if isinstance(value, str) else value
    return f"{{{place}, {c_number(_exact(variable.name, number))}, NULL}}"


def _exact(name: str, value: Any) -> float:
    """Return a value as a double; CommandError if it is an integer that a double cannot hold."""
    if isinstance(value, int) and int(float(value)) != value:
        raise CommandError(
            f"the start value {value} of {name} has too many digits: an FMU of a system holds integers up to "
            "2^53.",
            variable=name,
        )
    return float(value)


def _table(kind: str, name: str, rows: Iterable[str]) -> list[str]:
    """Return an array, with one empty element if it has none: C has no empty arrays."""
    listed = list(rows)
    return [f"static const {kind} {name}[] = {{", *(f"    {row}," for row in listed or ["0"]), "};", ""]


def _text(text: str) -> str:
    """Return a text as a C literal of its UTF-8 bytes."""
    plain = (chr(b) if 32 <= b < 127 and chr(b) not in '"\\?' else f"\\{b:03o}" for b in text.encode())
    return f'"{"".join(plain)}"'
