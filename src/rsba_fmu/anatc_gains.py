"""Gains of the ANATC-type controller, and the rule for tuned ones; joint files have the numbers."""

from dataclasses import dataclass


@dataclass(frozen=True)
class AnatcGains:
    """Gains of `AnatcController`, with the names and units of its parameters."""

    k_1: float
    k_2: float
    lambda_1: float
    lambda_2: float
    ell: tuple[float, float]
    g: float = 0.075
    b: float = 2.0
    w_c: float = 2500.0
    a_max: float = 1.2
    compensate: bool = False
    weaken_field: bool = False


def tuned(
    k_1: float,
    k_2: float,
    lambda_1: float,
    w_c: float,
    lambda_2: float,
    a_max: float,
    ell_1: float = 1e-6,
) -> AnatcGains:
    """Return gains found by search, with little leakage and a constant, wide sigma(t).

    So the bound's term stays smooth. With b > 0 it would become a sign function, which chatters in a
    sampled controller. With the leakage ell_1 of 1e-6 the weights drift under position noise, until the joint
    oscillates after 14 to 39 s; 1e-4 stops that.
    """
    return AnatcGains(
        k_1, k_2, lambda_1, lambda_2, (ell_1, 0.1), g=10.0, b=0.0, w_c=w_c, a_max=a_max, weaken_field=True
    )
