"""What a person should read of the cost of the exchange."""

from collections.abc import Mapping, Sequence

from ...base.wording import format_count
from .residual import Residual

LARGEST_ENERGY_ERROR = 0.02
"""The relative energy of a bond beyond which there is a remark; docs/master.md has the experiments."""

LARGEST_RESIDUAL = 0.03
"""The relative residual in a loop beyond which there is a remark; docs/master.md has the experiments."""

LARGEST_ACCUMULATED, GROWS = 0.3, 0.53
"""The accumulated residual of an oscillation that grows, and the centre of its motion that says it does."""

ADVICE = "Shorten the step, or use --extrapolation fmu, and see whether the results change."


def remarks(
    energies: Mapping[str, Mapping[str, float]],
    residuals: Mapping[str, Residual],
    judged: Sequence[str],
    free: Sequence[str],
) -> list[str]:
    """Return the sentences for figures beyond their thresholds.

    Args:
        energies: figures of bonds, by what the sentence calls the bond.
        residuals: those of connections, by name.
        judged: the connections that are looked at for oscillations that grow.
        free: the connections that belong to no bond, and are judged by their residual alone.

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
            f"{worst}: the signal oscillates more and more, and the coupling may be the cause: values used "
            f"were off by {_percent(x.relative)}, over {x.radians:.3g} rad{_more(growing)}."
        )
    return [*found[:-1], f"{found[-1]} {ADVICE}"] if found else []


def _percent(share: float) -> str:
    return f"{100.0 * share:.2g} %" if share < 1.0 else f"{100.0 * share:.3g} %"


def _more(found: Mapping[str, float]) -> str:
    others = len(found) - 1
    return (
        f", and so it is at {format_count(others, 'more connection', 'more connections')}" if others else ""
    )
