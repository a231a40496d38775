"""Rules for the gains of the observer, as published and improved; joint files have the numbers."""

from dataclasses import dataclass, fields, replace
from math import isclose


@dataclass(frozen=True)
class ObserverGains:
    """Gains of `EmlaObserver`, with the names and units of its parameters."""

    alpha_1: float
    alpha_2: float
    Q_11: float
    Q_12: float
    Q_22: float
    H_0: float
    m_0: float
    m_decay: float
    ell: float
    eta_hat_start: float
    """Start value of the adapted bound."""
    use_model: bool
    use_measured_current: bool = False
    omega_d: float = 0.0
    omega_r: float = 0.0
    ahead: float = 0.0
    interpolate: bool = False


def published(eta_hat_start: float) -> ObserverGains:
    """Return the gains of (85) to (87) as printed.

    The poles are at -0.16 +- 0.54j. As m also multiplies the leak in (23), eta_hat decays within
    milliseconds, and f has no effect.
    """
    return ObserverGains(
        alpha_1=0.3192,
        alpha_2=0.3129,
        Q_11=0.7752,
        Q_12=-0.0775,
        Q_22=0.3949,
        H_0=20.0,
        m_0=200.0,
        m_decay=0.001,
        ell=1.0,
        eta_hat_start=eta_hat_start,
        use_model=True,
    )


def robust(w: float = 4000.0) -> ObserverGains:
    """Return gains with both poles at -w rad/s, and m and H such that f has an effect.

    With Q = I the second element of p^-1 C' is 8, so f saturates at 8 eta_hat H m/s2, about the
    accelerations that the model lacks. Below that, f / y_bar = H^2 eta_hat^2 / m adds w^2 / 2 to
    alpha_2. The commanded torque is left out: without the load the model would be wrong.
    """
    return ObserverGains(
        alpha_1=2.0 * w,
        alpha_2=w * w,
        Q_11=1.0,
        Q_12=0.0,
        Q_22=1.0,
        H_0=1.0,
        m_0=16.0 / (w * w),
        m_decay=0.001,
        ell=1.0,
        eta_hat_start=1.0,
        use_model=False,
    )


def compensated(p: float) -> ObserverGains:
    """Return gains with all poles at -p rad/s that estimate the disturbance from current and position.

    f is off: d_hat compensates the disturbance that f would bound, and the kink of f lets noise through.
    """
    return ObserverGains(
        alpha_1=3.0 * p,
        alpha_2=3.0 * p * p,
        Q_11=1.0,
        Q_12=0.0,
        Q_22=1.0,
        H_0=0.0,
        m_0=1.0,
        m_decay=0.001,
        ell=1.0,
        eta_hat_start=0.0,
        use_model=True,
        use_measured_current=True,
        omega_d=p / 3.0,
        interpolate=True,
    )


def damped(p: float, ahead: float) -> ObserverGains:
    """Return gains like `compensated` with a fourth state, the rate of the disturbance.

    All four poles are at -p rad/s. d_hat predicts the disturbance by `ahead` in s.
    """
    return replace(
        compensated(p),
        alpha_1=4.0 * p,
        alpha_2=6.0 * p * p,
        omega_d=2.0 * p / 3.0,
        omega_r=0.25 * p,
        ahead=ahead,
    )


def with_poles(gains: ObserverGains, p: float) -> ObserverGains:
    """Return gains of the same kind with their poles at -p rad/s; the published ones stay unchanged."""
    if gains.omega_r > 0.0:
        return damped(p, gains.ahead)
    if gains.omega_d > 0.0:
        return compensated(p)
    return gains if gains.use_model else robust(p)


def describe(gains: ObserverGains) -> str:
    """Return the rule that gives these gains or the most of them, its arguments, and gains that differ."""
    damped_p, p, w = gains.alpha_1 / 4.0, gains.alpha_1 / 3.0, gains.alpha_1 / 2.0
    rules = {
        f"robust at {w:.6g} rad/s": robust(w),
        f"compensated at {p:.6g} rad/s": compensated(p),
        f"damped at {damped_p:.6g} rad/s, {1e3 * gains.ahead:.6g} ms ahead": damped(damped_p, gains.ahead),
        f"published with eta_hat {gains.eta_hat_start:.6g}": published(gains.eta_hat_start),
    }
    differences = {rule: _list_differences(gains, of_rule) for rule, of_rule in rules.items()}
    rule = min(differences, key=lambda name: len(differences[name]))
    return f"{rule}, but {', '.join(differences[rule])}" if differences[rule] else rule


def _list_differences(gains: ObserverGains, others: ObserverGains) -> list[str]:
    """Return the gains that differ by more than rounding, with their values."""
    values = {f.name: (float(getattr(gains, f.name)), float(getattr(others, f.name))) for f in fields(gains)}
    return [f"{name} = {a:.6g}" for name, (a, b) in values.items() if not isclose(a, b, rel_tol=1e-9)]
