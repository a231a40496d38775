"""What a port of a block needs beside its equations: values of the README's tables, and integration."""

import math
import re
from collections.abc import Callable, Mapping
from types import SimpleNamespace

from fmus.make_tables import readme

_ROW = re.compile(r"^\| (?:\$.+\$)? *\| `([^`]+)` \| \S* \| ([^|]*) \| ", re.MULTILINE)
_FIXED = {"true": 1.0, "false": 0.0}

Values = dict[str, float | list[float]]
Numbers = dict[str, float]
Laws = Callable[[Mapping, Numbers, SimpleNamespace, float], tuple[Numbers, Numbers]]
"""Parameters, states, inputs and time give the rates of the states and the outputs, all by name."""


def table(model: str) -> Values:
    """Return the start values of a README's tables by name; vectors as lists, `start.x` where x starts."""
    values_by_name: Values = {}
    for name, start in _ROW.findall(readme(model).read_text(encoding="utf-8")):
        if start.startswith("`"):
            values_by_name[name] = values_by_name.get(start.strip("`"), math.nan)
            continue
        if start == "start time":
            continue
        values = [_FIXED[v] if v in _FIXED else float(v) for v in start.replace(" ", "").split(",") if v]
        array, dots, last = name.removesuffix("]").partition("[1..")
        if dots:
            values_by_name[array] = values * int(last) if len(values) == 1 else values
        elif values:
            values_by_name[name] = values[0]
    return values_by_name


def clip(value: float, low: float, high: float) -> float:
    return min(max(value, low), high)


def stepped(laws: Laws, p: Mapping, x: Numbers, u: SimpleNamespace, t: float, h: float) -> Numbers:
    """Return the states after a step, by equal classical Runge-Kutta steps with held inputs."""
    count = math.ceil(h / p["solver.internal_step"] - 1e-9)
    part = h / count

    def rates(x: Numbers, t: float) -> Numbers:
        return laws(p, x, u, t)[0]

    def advance(x: Numbers, rate: Numbers, by: float) -> Numbers:
        return {name: value + by * rate[name] for name, value in x.items()}

    for i in range(count):
        now = t + i * part
        k_1 = rates(x, now)
        k_2 = rates(advance(x, k_1, part / 2.0), now + part / 2.0)
        k_3 = rates(advance(x, k_2, part / 2.0), now + part / 2.0)
        k_4 = rates(advance(x, k_3, part), now + part)
        mean = {n: (k_1[n] + 2.0 * k_2[n] + 2.0 * k_3[n] + k_4[n]) / 6.0 for n in x}
        x = advance(x, mean, part)
    return x
