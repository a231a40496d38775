"""Gains of the ANATC-type controller: as published, and tuned."""

from dataclasses import dataclass


@dataclass(frozen=True)
class AnatcGains:
    """Gains of `AnatcController`, named as its parameters; units there."""

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


PUBLISHED = {
    "lift": AnatcGains(0.14, 0.7, 1.22, 0.66, (0.03, 0.03)),
    "tilt": AnatcGains(0.24, 0.75, 1.08, 0.85, (0.03, 0.03)),
    "telescope": AnatcGains(0.1, 0.7, 1.15, 0.78, (0.01, 0.01), a_max=10.0),
    # none are printed for the experiments: those of the lift, whose motor comes closest
    "prototype": AnatcGains(0.14, 0.7, 1.22, 0.66, (0.03, 0.03), w_c=333.0),
}
"""Table V by joint. The current controllers' w_c is ours."""


def tuned(k_1: float, k_2: float, lambda_1: float, w_c: float, lambda_2: float, a_max: float) -> AnatcGains:
    """Gains found by search, with hardly a leak, and sigma(t) constant and wide: the bound stays smooth.

    With b > 0 that term becomes a sign function, which a sampled controller turns into chatter.
    """
    return AnatcGains(
        k_1, k_2, lambda_1, lambda_2, ell=(1e-6, 0.1), g=10.0, b=0.0, w_c=w_c, a_max=a_max, weaken_field=True
    )


TUNED = {
    "lift": tuned(1485.0, 1.89, 4014.0, 1919.0, 9.68, a_max=1.2),
    "tilt": tuned(328.0, 0.844, 997.0, 3399.0, 1.12, a_max=1.2),
    "telescope": tuned(268.0, 1.01, 122.0, 1957.0, 0.0151, a_max=10.0),
    "prototype": tuned(206.0, 0.5, 30.2, 274.0, 0.0266, a_max=1.2),
}
"""What `emla tune anatc-lift` and its like find; for the prototype by a search of its own."""
