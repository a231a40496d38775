"""Adaptive neural asymptotic tracking control of one EMLA, in the manner of "ANATC"."""

from typing import Any

from fmublock import Output, Parameter, State, dot, exp, maximum, sqrt, tanh, where

from . import drive_laws
from .drive_controller import DriveController

NODES = 5
"""Neurons of the network."""


class AnatcController(DriveController):
    """ANATC-type: adaptive neural asymptotic tracking with a bounded current and i_d assumed to be zero.

    Of the controller that the paper compares with (Zhang et al. 2023, "ANATC"), only the gains of
    Table V are available. This is not a copy, but the standard form in the literature with these gains.

    Standard:

    - Backstepping goes from position to speed to current, with the derivative of the virtual speed.
    - A network of Gaussian radial basis functions models the unknown. The speed error adapts its weights.
    - An adaptive bound covers the network's remaining error by a term z / sqrt(z^2 + sigma^2). The
      integral of sigma(t) is finite, which makes tracking asymptotic, and the term a sign function in
      the limit.
    - A smooth function, i_max tanh(i / i_max), keeps the current within its constraint. Its slope also
      slows adaptation down near the limit.
    - i_d is assumed to be zero: the laws do not contain it.

    Our reading:

    - k_1 and k_2 are the gains of position and speed. lambda_1 adapts the weights and lambda_2 the
      bound; ell_1 and ell_2 are their leaks. g and b give sigma(t) = g exp(-b t), which the leaks
      contain as well.
    - The source describes a rotary motor: from the speed step on, errors are in rad at the motor and
      controls in A. Read as 1/s at the screw, a gain of 0.7 cannot hold any joint's load.
    - Two gains mean two steps: the q-axis current is the control. Current controllers with decoupled
      axes and the bandwidth w_c control it, and keep i_d at zero. With `weaken_field`, i_d is not zero,
      which the laws do not know.
    - The network's input is the speed over v_max. Its centres are evenly spaced from -1 to 1.
    - `approach` limits the virtual speed to what can be braked. Adaptation stops while the voltage is
      at its limit.
    """

    k_1 = Parameter(0.14, unit="1/s", minimum=1e-9, description="Gain of the position")
    k_2 = Parameter(0.7, unit="A.s/rad", minimum=0.0, description="Gain of the speed")
    lambda_1 = Parameter(1.22, minimum=0.0, unit="A/rad", description="Rate of adaptation of the weights")
    lambda_2 = Parameter(0.66, minimum=0.0, unit="A/rad", description="Rate of adaptation of the bound")
    ell = Parameter(0.03, shape=2, minimum=0.0, description="Leak of weights and of bound, times sigma(t)")
    g = Parameter(0.075, unit="rad/s", minimum=1e-12, description="sigma(t) = g exp(-b t) at t = 0")
    b = Parameter(2.0, unit="1/s", minimum=0.0, description="Decay of sigma(t); 0 keeps it constant")
    sigma_min = Parameter(
        1e-9, unit="rad/s", minimum=1e-12, description="Least sigma(t), so that no step divides by zero"
    )
    w_c = Parameter(2500.0, unit="1/s", minimum=1e-9, description="Bandwidth of the current controllers")

    W = State(0.0, shape=NODES, unit="A", description="Weights of the network")
    delta = State(0.0, unit="A", minimum=0.0, description="Bound of the network's remaining error")

    z_1 = Output(unit="m", name="z[1]", description="Error of the position")
    z_2 = Output(unit="m/s", name="z[2]", description="Error of the speed")
    unknown = Output(unit="A", description="Current that network and bound use against the unknown dynamics")

    def derivatives(self, v: Any) -> dict[str, Any]:
        """Return the adaptation of the weights and of the bound."""
        omega = v.alpha_RL * self.errors(v)[1]
        sigma = self.sigma(v)
        _, slope, _ = self.current(v)
        learning = slope * (1.0 - self.voltage_control(v)[4])
        S = self.network(v)
        return {
            "W": [v.lambda_1 * (learning * S[i] * omega - v.ell[0] * sigma * v.W[i]) for i in range(NODES)],
            "delta": v.lambda_2
            * (learning * omega * self.smooth_sign(omega, sigma) - v.ell[1] * sigma * v.delta),
        }

    def outputs(self, v: Any) -> dict[str, Any]:
        """Return voltages, commanded current, errors, and the estimate of the unknown."""
        z_1, z_2, _ = self.errors(v)
        u_q, u_d, _, _, voltage_limited = self.voltage_control(v)
        i_q_ref, _, current_limited = self.current(v)
        return {
            "u_q": u_q,
            "u_d": u_d,
            "i_q_ref": i_q_ref,
            "saturated": maximum(current_limited, voltage_limited),
            "z_1": z_1,
            "z_2": z_2,
            "unknown": self.estimated(v),
        }

    def errors(self, v: Any) -> tuple[Any, Any, Any]:
        """Return z_1, z_2, and the derivative of the virtual speed in m/s2."""
        z_1 = v.x_hat - v.x_d
        w, slope = drive_laws.approach(v, v.k_1, -z_1)
        return z_1, v.v_hat - v.v_d - w, v.a_d - slope * (v.v_hat - v.v_d)

    def current(self, v: Any) -> tuple[Any, Any, Any]:
        """Return i_q* within its constraint, the constraint's slope, and 1 if that is below 0.5, else 0."""
        z_1, z_2, virtual_rate = self.errors(v)
        known = virtual_rate - drive_laws.known_acceleration(v, 0.0) - v.compensate * v.d_hat
        needed = known / drive_laws.acceleration_per_current(v) - self.estimated(v)
        limit = maximum(drive_laws.current_limit(v, drive_laws.steady_voltage(v)), 1e-9)  # 0 without a supply
        part = tanh((needed - v.alpha_RL * (v.k_2 * z_2 + z_1)) / limit)
        slope = 1.0 - part * part
        return limit * part, slope, where(slope < 0.5, 1.0, 0.0)

    def voltage_control(self, v: Any) -> tuple[Any, Any, Any, Any, Any]:
        """Return the outputs of the current controllers; see `DriveController.voltage`."""
        i_q_ref = self.current(v)[0]
        i_d_ref = self.weakening(v, i_q_ref)
        return self.voltage(v, v.w_c * (i_q_ref - v.i_q), v.w_c * (i_d_ref - v.i_d))

    def estimated(self, v: Any) -> Any:
        """Return the estimate of network and bound in A."""
        omega = v.alpha_RL * self.errors(v)[1]
        return dot(v.W, self.network(v)) + v.delta * self.smooth_sign(omega, self.sigma(v))

    def network(self, v: Any) -> list[Any]:
        """Return the Gaussian basis functions, half a unit apart and as wide."""
        distances = [v.v_hat / v.v_max - (2.0 * i / (NODES - 1) - 1.0) for i in range(NODES)]
        return [exp(-2.0 * d * d) for d in distances]

    def sigma(self, v: Any) -> Any:
        """Return the width of the smooth sign in rad/s, which shrinks to `sigma_min`."""
        return maximum(v.g * exp(-v.b * v.time), v.sigma_min)

    def smooth_sign(self, z: Any, sigma: Any) -> Any:
        """Return the sign of z, smooth over a width of sigma: z / sqrt(z^2 + sigma^2)."""
        return z / sqrt(z * z + sigma * sigma)
