"""Remarks for users on the coupling error."""

from collections.abc import Mapping, Sequence

from ...base.wording import format_count
from .residual import Residual

LARGEST_ENERGY_ERROR = 0.02
"""Relative energy error of a bond above which a remark is added; docs/master.md has the experiments."""

LARGEST_RESIDUAL = 0.03
"""Relative residual in a loop above which a remark is added; docs/master.md has the experiments."""

LARGEST_ACCUMULATED, GROWS = 0.3, 0.53
"""Accumulated residual, and centre of motion, above which an oscillation is reported as growing."""

ADVICE = "Shorten the step, or use --extrapolation fmu, and see whether the results change."


def remarks(
    energies: Mapping[str, Mapping[str, float]],
    residuals: Mapping[str, Residual],
    judged: Sequence[str],
    free: Sequence[str],
) -> list[str]:
    """Return the remarks for figures above their thresholds.

    Args:
        energies: Figures of bonds, by the name of the bond in remarks.
        residuals: Residuals of connections, by name.
        judged: Connections that are checked for growing oscillations.
        free: Connections without a bond, whose residual is checked.
    """
    found = [
        f"The coupling created or destroyed {_percent(x['energy_error'])} of the energy exchanged at the "
        f"bond {name}: {x['energy_error_J']:.3g} J of {x['energy_exchanged_J']:.3g} J."
        for name, x in energies.items()
        if x["energy_error"] > LARGEST_ENERGY_ERROR
    ]
    large = {name: x.relative for name in free if (x := residuals[name]).relative > LARGEST_RESIDUAL}
    if large:
        worst = max(large, key=large.__getitem__)
        found.append(
            f"{worst}: the values used within a step were off by {_percent(large[worst])} of the signal's "
            f"variation (rms){_more(large)}."
        )
    growing = {
        name: x.accumulated
        for name in judged
        if (x := residuals[name]).accumulated > LARGEST_ACCUMULATED and x.centre > GROWS
    }
    if growing:
        worst = max(growing, key=growing.__getitem__)
        x = residuals[worst]
        found.append(
            f"{worst}: the oscillation of the signal grows, and the coupling may be the cause: the values "
            f"used were off by {_percent(x.relative)}, over {x.radians:.3g} rad{_more(growing)}."
        )
    return [*found[:-1], f"{found[-1]} {ADVICE}"] if found else []


def _percent(share: float) -> str:
    return f"{100.0 * share:.2g} %" if share < 1.0 else f"{100.0 * share:.3g} %"


def _more(found: Mapping[str, float]) -> str:
    others = len(found) - 1
    return (
        f"; the same applies to {format_count(others, 'more connection', 'more connections')}"
        if others
        else ""
    )
