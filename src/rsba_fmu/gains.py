"""Gains of the RSBA controller, and rules for them; joint files have the numbers."""

from dataclasses import dataclass, replace

Four = tuple[float, float, float, float]


@dataclass(frozen=True)
class RsbaGains:
    """Gains and options of `RsbaController`, with the names and units of its parameters."""

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
    i_reserve: float = 0.0
    omega_u: float = 0.0


def robust(
    beta_1: float, beta_2: float, a_max: float, beta_3: float = 5000.0, zeta: float = 100.0
) -> RsbaGains:
    """Return gains of a cascade with faster inner loops, with feed-forward, limits and frozen adaptation.

    The bandwidths are beta_1 / 2 < beta_2 / 2 < beta_3 / 2 = 2500 rad/s. Each loop is at least twice as
    fast as the one around it; the fastest is at a quarter of the rate of 0.1 ms samples. zeta is the
    published value of the lift. With delta and sigma, theta_hat decays within a second.
    """
    return RsbaGains(
        beta=(beta_1, beta_2, beta_3, beta_3),
        zeta=(zeta, zeta, zeta, zeta),
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


def compensated(T_s: float, k_1: float, k_2: float, a_max: float) -> RsbaGains:
    """Return gains with compensated disturbances, for a drive that samples every T_s seconds.

    All rates are fractions of 1 / T_s, so that one rule works for 10 kHz and 1 kHz:

    - The bandwidth of the current loops is beta_3 / 2 = beta_4 / 2 = 0.2 / T_s. With one sample of
      computing delay and half a sample of hold, the phase margin is 73 degrees; with three samples more,
      39 degrees.
    - omega_u = 0.03 / T_s is a seventh of the current loops, as the integral part of a PI controller.
    - The bandwidth of the speed loop is beta_2 / 2 = k_2 / T_s, less than half of the current loops. k_2
      and the observer's poles determine how much torque noise the position noise causes.
    - The bandwidth of the position loop is beta_1 / 2 = k_1 / T_s. The speed loop then has a damping of
      1 / 2.

    k_1, k_2 and the observer's poles were set by hand for the paper's torque and a speed limit. They do not
    meet the noise condition of `emla tune`: with noise of 1 um, lift and tilt are at a limit for 12 and 13 %
    of the time, but 5 % are allowed.

    Adaptation is off: theta_hat follows |P|^2, which is mostly noise. With zeta = 100 the errors of the study
    decrease by a tenth, but with noise of 1 um lift and tilt exceed tau_max.

    Args:
        T_s: Sample time, s.
        k_1: Bandwidth of the position loop times T_s.
        k_2: Bandwidth of the speed loop times T_s.
        a_max: Braking acceleration, m/s2.
    """
    repaired = robust(2.0 * k_1 / T_s, 2.0 * k_2 / T_s, a_max, beta_3=0.4 / T_s, zeta=0.0)
    return replace(
        repaired,
        limit_speed=True,
        compensate=True,
        weaken_field=True,
        measure_supply=True,
        u_reserve=0.2,
        i_reserve=0.02,
        omega_u=0.03 / T_s,
    )


def damped(
    T_s: float, k_1: float, k_2: float, a_max: float, k_3: float = 0.2, k_u: float = 0.02
) -> RsbaGains:
    """Return gains with healthy stability margins, for a drive that samples every T_s seconds.

    The law, limits and reserves are those of `compensated`. The loops of position and speed are slower, those
    of the currents faster. With one sample of computing delay, each loop has a phase margin of at least
    30 degrees, gain margins of at least 6 dB both ways, and an Ms of at most 2.2.

    A search found the numbers and the observer's: a linear model of the sampled loop gave margins and noise,
    a simulation the error. The estimated voltage disturbance, k_u, decides how long dead time of the inverter
    displaces the screw when a phase current reverses.

    Args:
        T_s: Sample time, s.
        k_1: Bandwidth of the position loop times T_s.
        k_2: Bandwidth of the speed loop times T_s.
        a_max: Braking acceleration, m/s2.
        k_3: Bandwidth of the current loops times T_s.
        k_u: Bandwidth of the estimated voltage disturbances times T_s.
    """
    gains = compensated(T_s, k_1, k_2, a_max)
    currents = 2.0 * k_3 / T_s
    return replace(gains, beta=(*gains.beta[:2], currents, currents), omega_u=k_u / T_s)
