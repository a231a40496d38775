"""Tables of files become structs; every fault is named with its place and remedy."""

from typing import Annotated, Any, Literal

import msgspec
import pytest

from emla_cosim.base.errors import CommandError
from emla_cosim.base.toml_structs import describe, dotted, extend_struct, one_of, quantity, read_toml
from emla_cosim.base.values import convert_value


class Spring(msgspec.Struct, frozen=True, kw_only=True):
    kind: Literal["spring"]
    stiffness: Annotated[float, quantity("N/m", "stiffness", "3 kN/m", gt=0.0)]


class Damper(msgspec.Struct, frozen=True, kw_only=True):
    damping: Annotated[float, quantity("N.s/m", "damping")] = 0.0


class Part(msgspec.Struct, frozen=True, kw_only=True):
    length: Annotated[float, quantity("m", "length", 0.2)]
    count: Annotated[int, describe("number of parts", ge=1)] = 1
    is_used: bool = True

    def __post_init__(self) -> None:
        if self.length > 1.0 and self.count > 1:
            raise ValueError("is too long for several.")


class Machine(msgspec.Struct, frozen=True, kw_only=True):
    name: str = ""
    part: Annotated[Part, describe("part that moves")]
    spare: list[Part] = msgspec.field(default_factory=list)
    forces: Annotated[tuple[float, ...], quantity("N", "forces", [1.0, 2.0])] = ()
    set: Annotated[dict[str, float], dotted("values by name")] = msgspec.field(default_factory=dict)
    mount: Annotated[Any, one_of("kind", {None: Damper, "spring": Spring})] = None


GOOD = 'part = { length = "20 cm" }\n'


def read(text: str) -> Machine:
    return convert_value(read_toml(text, "'m.toml'"), Machine, "'m.toml'")


def test_quantities_lists_and_names_with_dots() -> None:
    machine = read(
        'name = "m"\nforces = "2 kN"\npart = { length = "20 cm", count = 3 }\nspare = [{ length = 1 }]\n'
        'mount = { kind = "spring", stiffness = 2.0 }\n[set]\na.b.c = 1\n"a.b.d" = 2\n'
    )
    assert machine == Machine(
        name="m",
        part=Part(length=0.2, count=3),
        spare=[Part(length=1.0)],
        forces=(2000.0,),
        set={"a.b.c": 1.0, "a.b.d": 2.0},
        mount=Spring(kind="spring", stiffness=2.0),
    )
    assert read(f"{GOOD}mount = {{ damping = 3 }}").mount == Damper(damping=3.0)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("part = {", "'m.toml' is not TOML: "),
        ("x = " + "[" * 100_000, "'m.toml' is not TOML: "),
        ("x = " + "9" * 5000, "'m.toml' is not TOML: "),
        ("", "'m.toml' lacks the table [part], the part that moves."),
        ("part = 1", "'part' of 'm.toml' is 1; it must be a table, [part]."),
        ("[part]", "[part] of 'm.toml' lacks length, the length; write length = 0.2."),
        (
            "part = { lenght = 1 }",
            "[part] of 'm.toml' has the unknown entry 'lenght'; did you mean 'length'?",
        ),
        ('part = { length = "3 s" }', "'length' in [part] of 'm.toml' has the units s and m, which"),
        (
            "part = { length = true }",
            "'length' in [part] of 'm.toml' is True; it must be a number in m, or a",
        ),
        ("part = { length = inf }", "'length' in [part] of 'm.toml' is inf; it must be a finite number."),
        ("part = { length = 1, count = 0 }", "'count' in [part] of 'm.toml' is 0; it must be at least 1."),
        ("part = { length = 2, count = 2 }", "[part] of 'm.toml' is too long for several."),
        (f"{GOOD}spare = [{{}}]", "[[spare]] 1 of 'm.toml' lacks length"),
        (
            f"{GOOD}mount = {{ kind = 'rope' }}",
            "'kind' in [mount] of 'm.toml' is 'rope'; it must be 'spring'.",
        ),
        (
            f"{GOOD}set.a.b = 1\nset.'a.b' = 2",
            "[set] of 'm.toml' has the entry 'a.b' twice, with and without",
        ),
    ],
)
def test_fault_has_one_message(text: str, message: str) -> None:
    with pytest.raises(CommandError) as caught:
        read(text)
    assert str(caught.value).startswith(message)
    assert "\n" not in str(caught.value).removeprefix(message).rstrip()


def test_all_faults_of_a_file_are_listed() -> None:
    with pytest.raises(CommandError) as caught:
        read("nam = 'm'\nforces = ['x']\npart = { length = -1, count = 'many', is_used = 1 }\n")
    assert str(caught.value).startswith("'m.toml' cannot be used for 4 reasons:\n  ")
    assert len(caught.value.fields["problems"]) == 4


def test_fields_are_extended() -> None:
    longer = extend_struct(
        Part, "Longer", [("width", Annotated[float, quantity("m", "width")], msgspec.UNSET)]
    )
    assert convert_value({"length": 1, "width": "3 mm"}, longer, "x").width == 0.003
    assert convert_value({"length": 1}, longer, "x").width is msgspec.UNSET
