"""Parameters of a block as a table of a joint file, by the names of its FMU."""

import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any, NoReturn

import msgspec

from emla_fmu import Disturbance, EmlaPlant
from emla_fmu.drive import DriveParameters
from emla_fmu.parameters import EmlaParameters
from fmublock import Block
from fmublock.variables import Variable

from ...base.errors import CommandError
from ...base.table_entries import Location
from ...base.toml_structs import describe, extend_struct, quantity


def build_block_struct(block: type[Block], reserved: Mapping[str, str]) -> type[msgspec.Struct]:
    """Return the struct with the parameters of a block; its attributes are those of the block.

    Args:
        block: The block.
        reserved: Parameters that another table sets, each with what to do instead.
    """
    fields: list[Any] = [
        (
            variable.attribute,
            _build_reserved_field(reserved[str(variable.name)])
            if str(variable.name) in reserved
            else _get_type(variable),
            msgspec.field(name=str(variable.name), default=msgspec.UNSET),
        )
        for variable in block.layout().parameters
    ]
    return extend_struct(msgspec.Struct, block.__name__, fields)


def _build_reserved_field(remedy: str) -> Any:
    def refuse(_value: Any, at: Location, _folder: Path | None) -> NoReturn:
        raise CommandError(f"{at.label} must not be set here; {remedy}.")

    return Annotated[Any, describe(read=refuse, extra_json_schema={"not": {}})]


def _get_type(variable: Variable) -> Any:
    """Return the type of a parameter: a number, or a tuple of them for an array."""
    if variable.fmi_type != "Real":
        type_ = bool if variable.fmi_type == "Boolean" else int
        return Annotated[type_, describe(variable.description)]
    number = Annotated[float, quantity(variable.unit or "", variable.description)]
    return tuple[(number,) * math.prod(variable.shape)] if variable.shape else number


def _list_fmi_names(block: type[Block], attributes: Iterable[str]) -> set[str]:
    return {str(x.name) for x in block.layout().parameters if x.attribute in set(attributes)}


_SEED = "write it as seed, before the first table"
_RESERVED_OF_DISTURBANCE = {
    **dict.fromkeys(
        _list_fmi_names(Disturbance, ("level", "level_start", "ramp", "ripple", "ripple_omega")),
        "write the load in [load]",
    ),
    "d_2.seed": _SEED,
}
_RESERVED_OF_PLANT = {
    **dict.fromkeys(
        _list_fmi_names(EmlaPlant, DriveParameters.__dataclass_fields__), "write it in [actuator] or [drive]"
    ),
    **dict.fromkeys(
        _list_fmi_names(EmlaPlant, [*EmlaParameters.__dataclass_fields__, "i_max", "i_range"]),
        "it follows from [actuator]",
    ),
    "sensor.seed": _SEED,
    "sensor.current.seed": "it follows from seed",
    "start.x_L": "write it as x_L in [start]",
    "use_commanded_current": "the scenario decides it",
}

DISTURBANCE = build_block_struct(Disturbance, _RESERVED_OF_DISTURBANCE)
PLANT = build_block_struct(EmlaPlant, _RESERVED_OF_PLANT)
