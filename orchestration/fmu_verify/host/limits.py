"""Declared limits of variables."""

import math
from typing import Any

from fmpy.model_description import ModelVariable


def limits_of(variable: ModelVariable) -> tuple[float, float]:
    """Return min and max of a variable or its declared type, infinite if there are none."""
    declared = variable.declaredType
    ends = [
        getattr(variable, name) if getattr(variable, name) is not None else getattr(declared, name, None)
        for name in ("min", "max")
    ]
    return parse_number(ends[0], -math.inf), parse_number(ends[1], math.inf)


def parse_number(value: Any, otherwise: float) -> float:
    """Convert an attribute to a number; return `otherwise` if it is not finite."""
    try:
        number = float(value)
    except (TypeError, ValueError):
        return otherwise
    return number if math.isfinite(number) else otherwise
