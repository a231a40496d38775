"""Gains of the RSBA controller: as published, and repaired."""

from dataclasses import dataclass

Four = tuple[float, float, float, float]


@dataclass(frozen=True)
class RsbaGains:
    """Gains and repairs of `RsbaController`, named as its parameters; units and reasons there."""

    beta: Four
    zeta: Four
    delta: Four
    sigma: Four
    x_2d_in_a_1: bool = True
    feed_acceleration: bool = False
    limit_acceleration: bool = False
    limit_current: bool = False
    limit_voltage: bool = False
    freeze_adaptation: bool = False
    a_max: float = 1.2
    limit_speed: bool = False
    compensate: bool = False
    weaken_field: bool = False
    measure_supply: bool = False
    u_reserve: float = 0.1
    omega_u: float = 0.0


PUBLISHED = {
    "lift": RsbaGains(
        beta=(3000.0, 3000.0, 1000.0, 1000.0),
        zeta=(100.0, 100.0, 100.0, 100.0),
        delta=(100.0, 100.0, 110.0, 110.0),
        sigma=(0.001, 0.001, 0.01, 0.01),
    ),
    "tilt": RsbaGains(
        beta=(2000.0, 2000.0, 750.0, 750.0),
        zeta=(100.0, 100.0, 80.0, 80.0),
        delta=(100.0, 100.0, 80.0, 80.0),
        sigma=(0.001, 0.001, 0.01, 0.01),
    ),
    "telescope": RsbaGains(
        beta=(800.0, 800.0, 420.0, 420.0),
        zeta=(0.001, 0.001, 1.0, 1.0),
        delta=(1.0, 1.0, 0.5, 0.5),
        sigma=(1.0, 1.0, 1.0, 1.0),
    ),
    "prototype": RsbaGains(
        beta=(15.0, 1500.0, 5.0, 1.0),
        zeta=(100.0, 100.0, 100.0, 100.0),
        delta=(100.0, 100.0, 100.0, 100.0),
        sigma=(0.001, 0.001, 0.001, 0.001),
    ),
}
"""Table V by joint, and the gains of the experiments (Section V)."""


def robust(beta_1: float, beta_2: float, a_max: float) -> RsbaGains:
    """All repairs on, and a cascade whose inner loops are the faster ones.

    The loops run at beta_1 / 2 < beta_2 / 2 < beta_3 / 2 = 2500 rad/s, each at least twice as
    fast as the one around it, and the fastest at a quarter of a 0.1 ms sample. zeta is the
    published one of the lift; delta and sigma let theta_hat forget within a second.
    """
    return RsbaGains(
        beta=(beta_1, beta_2, 5000.0, 5000.0),
        zeta=(100.0, 100.0, 100.0, 100.0),
        delta=(1.0, 1.0, 1.0, 1.0),
        sigma=(1.0, 1.0, 1.0, 1.0),
        x_2d_in_a_1=False,
        feed_acceleration=True,
        limit_acceleration=True,
        limit_current=True,
        limit_voltage=True,
        freeze_adaptation=True,
        a_max=a_max,
    )


ROBUST = {
    "lift": robust(800.0, 2000.0, a_max=1.2),
    # the random part of tilt's disturbance (82) comes back as torque: less gain, less of it
    "tilt": robust(600.0, 1200.0, a_max=1.2),
    "telescope": robust(1000.0, 2500.0, a_max=10.0),
}
"""Repaired gains by joint; a_max is what the joint's motor can brake with its load."""


def compensated(fastness: float, a_max: float) -> RsbaGains:
    """All repairs on, and disturbances estimated and taken off.

    `fastness` times (250, 800, 2000) rad/s are beta_1 / 2, beta_2 / 2 and beta_3 / 2.
    """
    return RsbaGains(
        beta=(500.0 * fastness, 1600.0 * fastness, 4000.0, 4000.0),
        zeta=(0.0, 0.0, 0.0, 0.0),
        delta=(1.0, 1.0, 1.0, 1.0),
        sigma=(1.0, 1.0, 1.0, 1.0),
        x_2d_in_a_1=False,
        feed_acceleration=True,
        limit_acceleration=True,
        limit_current=True,
        limit_voltage=True,
        freeze_adaptation=True,
        a_max=a_max,
        limit_speed=True,
        compensate=True,
        weaken_field=True,
        measure_supply=True,
        u_reserve=0.2,
        omega_u=500.0,
    )


COMPENSATED = {
    "lift": compensated(1.0, a_max=1.2),
    "tilt": compensated(1.0, a_max=1.5),
    "telescope": compensated(1.0, a_max=10.0),
}
