"""Compute the smallest load error that linear laws can reach in `study-compliant`, and draw it.

    python docs/load_bound.py FOLDER

docs/load-bound.md explains the method. It takes a minute, and writes `load-bound.json` and
`load-bound.png` into the folder. Units here: um, kN, s; masses are in kN s2/um.
"""

import json
import sys
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from scipy.linalg import expm, solve_discrete_are
from scipy.optimize import linprog

from emla_cosim.study.joints.schema import load_joint
from emla_cosim.views.plots.style import BLUE, GREY, ORANGE, tidy_axes

Vector = np.ndarray[Any, np.dtype[Any]]

STEP = 1e-4
"""Sample time in s; a demanded torque acts one sample later."""
ROWS = 2**17
"""Samples of the transforms: 13 s, so that responses to 10 s of disturbance decay."""
RUN, EVALUATED = 10.0, 0.4
"""Length of a run, and the time from which its errors count, in s."""
RIPPLE = {"lift": 37.6, "tilt": 12.3, "telescope": 0.51}
"""Torque ripple of a practical law per um of position noise, N m rms; simulated."""
MS = 2.2
PEAK = 3.3
"""Peak of a narrow-band noise in 10 s over its standard deviation."""
LOAD_NOISE = 1.0
"""Noise of the load sensor in um rms: one step of a linear scale of 1 um."""
TOLERANCE = 5e-3
"""Relative violation of a constraint at which no more cuts are added."""


@dataclass(frozen=True)
class TwoMasses:
    """A joint: screw and load, the forces on the screw, and the deflection under the load force."""

    name: str
    m_1: float
    m_2: float
    k: float
    c: float
    b: float
    F_L: float
    alpha: float
    w: Vector
    """Known part of the force on the screw over time: d_2, friction and losses, kN."""
    w_random: float
    """Standard deviation of its random part, which is new every sample, kN."""

    @classmethod
    def of(cls, name: str) -> "TwoMasses":
        """Read a joint file."""
        joint = load_joint(name)
        F_L = joint.load.parameters()["level"][0]
        load, emla, d = joint.compliant_load.parameters(F_L), joint.emla, joint.disturbance
        alpha, t = emla.alpha_RL, np.arange(round(RUN / STEP)) * STEP
        distance, T = joint.reference.q_E - joint.reference.q_S, 15.0 / 8.0 / joint.reference.v_peak
        T *= abs(distance)
        r = np.clip(t / T, 0.0, 1.0)
        v = distance / T * 30.0 * (r * (1.0 - r)) ** 2
        m_1 = alpha * emla.A_eq
        d_2 = d.get("arctan_2", 0.0) * np.arctan(v) * np.exp(-d.get("decay_2", 0.0) * t)
        phases = d.get("phase_2", [0.0, 0.0])
        for size, omega, phase in zip(d["amplitude_2"], d["omega_2"], phases, strict=True):
            d_2 += size * np.sin(omega * t + phase)
        low, high = d.get("low_2", 0.0), d.get("high_2", 0.0)
        F_C, v_S, v_0 = 0.01 * emla.tau_max * alpha, 10.0 / alpha, 0.1 / alpha
        direction = v / np.sqrt(v * v + v_0 * v_0)
        friction = F_C * (1.0 + 0.5 / (1.0 + (v / v_S) ** 2)) + (1.0 / emla.eta_GB - 1.0) * abs(F_L)
        w = m_1 * (d_2 + 0.5 * (low + high)) - friction * direction
        return cls(
            name, 1e-9 * m_1, 1e-9 * load["m_load"], 1e-9 * load["stiffness"], 1e-9 * load["damping"],
            1e-9 * alpha * emla.B_eq, 1e-3 * F_L, alpha, 1e-3 * w,
            1e-3 * m_1 * (high - low) / np.sqrt(12.0),
        )  # fmt: skip

    def sampled(self) -> tuple[Vector, Vector]:
        """Return A and B of x_1, v_1, x_2, v_2, for held forces on the screw and on the load."""
        k, c, m_1, m_2 = self.k, self.c, self.m_1, self.m_2
        A = np.array(
            [
                [0.0, 1.0, 0.0, 0.0],
                [-k / m_1, -(c + self.b) / m_1, k / m_1, c / m_1],
                [0.0, 0.0, 0.0, 1.0],
                [k / m_2, c / m_2, -k / m_2, -c / m_2],
            ]
        )
        B = np.array([[0.0, 0.0], [1.0 / m_1, 0.0], [0.0, 0.0], [0.0, -1.0 / m_2]])
        both = expm(STEP * np.block([[A, B], [np.zeros((2, 6))]]))
        return both[:4, :4], both[:4, 4:]


class Loop:
    """All linear laws of a joint: a stabilising law, and what is added to it by Q.

    `u = -K x_hat - d_hat + Q (y - y_hat)` with a stable Q is every stabilising law (Youla, 1976), and the
    closed loop is affine in Q. Responses are arrays over frequency.
    """

    def __init__(self, joint: TwoMasses, has_load_sensor: bool, order: int) -> None:
        self.joint, self.sensors = joint, 2 if has_load_sensor else 1
        A, B = joint.sampled()
        A_d = np.zeros((6, 6))  # x_1, v_1, x_2, v_2, delayed force, disturbance force on the screw
        A_d[:4, :4], A_d[:4, 4], A_d[:4, 5], A_d[5, 5] = A, B[:, 0], B[:, 0], 1.0
        B_u = np.eye(6)[:, [4]]
        C = np.eye(6)[[0, 2][: self.sensors]]
        size = joint.m_1 * 200.0**2  # kN/um: stiffness of a loop of 200 rad/s
        swing = np.zeros((5, 5))
        swing[0, 0] = swing[2, 2] = 1.0
        X = solve_discrete_are(A_d[:5, :5], B_u[:5], swing, np.array([[1.0 / size**2]]))
        K = np.linalg.solve(B_u[:5].T @ X @ B_u[:5] + 1.0 / size**2, B_u[:5].T @ X @ A_d[:5, :5])
        K = np.append(K, 1.0)[None]
        drift, push = 1e3 * size, size  # kN in a sample, against 1 um of noise
        W = np.outer(np.eye(6)[5], np.eye(6)[5]) * (drift * STEP) ** 2
        for column in B.T:
            forced = np.append(column, [0.0, 0.0])
            W += np.outer(forced, forced) * (2.0 * push) ** 2
        P = solve_discrete_are(A_d.T, C.T, W, np.eye(self.sensors))
        L = A_d @ P @ C.T @ np.linalg.inv(C @ P @ C.T + np.eye(self.sensors))

        n = self.sensors
        closed = np.zeros((11, 11))
        closed[:5, :5], closed[4, 5:] = A_d[:5, :5], -K[0]
        closed[5:, :5] = L @ C[:, :5]
        closed[5:, 5:] = A_d - L @ C - B_u @ K
        inputs = np.zeros((11, 3 + n))  # w, F_L, noise of each sensor, v
        inputs[:4, :2], inputs[5:, 2 : 2 + n] = B, L
        inputs[4, -1] = inputs[9, -1] = 1.0
        outputs = np.zeros((2 + 2 * n, 11))  # x_2, u, y, y - y_hat
        outputs[0, 2], outputs[1, 5:] = 1.0, -K[0]
        outputs[2 : 2 + n, :5] = C[:, :5]
        outputs[2 + n :] = np.hstack((C[:, :5], -C))
        direct = np.zeros((2 + 2 * n, 3 + n))
        direct[1, -1] = 1.0
        direct[2 : 2 + n, 2 : 2 + n] = direct[2 + n :, 2 : 2 + n] = np.eye(n)
        assert abs(np.linalg.eigvals(closed)).max() < 1.0
        z = np.exp(2j * np.pi * np.arange(ROWS // 2 + 1) / ROWS)
        states = np.empty((len(z), 11, 3 + n), complex)
        for part in np.array_split(np.arange(len(z)), 16):
            states[part] = np.linalg.solve(z[part, None, None] * np.eye(11) - closed, inputs[None])
        self.H = outputs @ states + direct
        self.basis = basis(z, joint, order)

    def affine(self, output: int, source: int) -> Vector:
        """Return a response: a column without Q, then a column for each unknown of Q."""
        H, n = self.H, self.sensors
        columns = [H[:, output, source]]
        for sensor in range(n):
            columns += list(H[:, output, -1] * H[:, 2 + n + sensor, source] * self.basis)
        return np.array(columns).T

    @cached_property
    def errors(self) -> Vector:
        """Load error over time by the known forces, every ms, affine in Q; the load force is known."""
        spectrum = np.fft.rfft(self.joint.w, ROWS)
        return self.in_time(self.affine(0, 0) * spectrum[:, None])

    def unknown_load(self, force: float) -> Vector:
        """Return the further load error over time if the load force is larger than the law believes, kN.

        The load rests on its spring before the start. The motor lacks the force from then on.
        """
        lacking = np.fft.rfft(np.full(round(RUN / STEP), -force), ROWS)
        error = self.in_time(self.affine(0, 0) * lacking[:, None])
        error[:, 0] -= force / self.joint.k
        return error

    def load_step(self, force: float) -> Vector:
        """Return the further load error over time by a step of the load force at 0.5 s, kN."""
        step = np.zeros(round(RUN / STEP))
        step[5000:] = force
        return self.in_time(self.affine(0, 1) * np.fft.rfft(step, ROWS)[:, None])

    def in_time(self, spectrum: Vector) -> Vector:
        """Return the part of a response that counts, every ms."""
        return np.fft.irfft(spectrum, ROWS, axis=0)[round(EVALUATED / STEP) : round(RUN / STEP) : 10]

    def gram(self, output: int, sources: dict[int, float]) -> Vector:
        """Return R with |R (1, q)| = the standard deviation of an output by white noises."""
        total = 0.0
        for source, sigma in sources.items():
            x = self.affine(output, source) * sigma
            weights = np.full(len(x), 2.0)
            weights[[0, -1]] = 1.0
            total = total + (x.conj().T * weights @ x).real / ROWS
        values, vectors = np.linalg.eigh(total)
        return np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T


def basis(z: Vector, joint: TwoMasses, order: int) -> Vector:
    """Return orthonormal functions of Takenaka and Malmquist.

    Their poles are real, from 5 to 6000 rad/s, and pairs at the frequency of the load on a held screw, also
    with its own damping: a law that holds the screw leaves this swing as it is.
    """
    real = np.geomspace(5.0, 6e3, order)
    natural = np.sqrt(joint.k / joint.m_2)
    own = 0.5 * joint.c / np.sqrt(joint.k * joint.m_2)
    zeta, at = np.array([own, own, 0.1, 0.4, 0.3, 0.3]), np.array([1.0, 1.0, 1.0, 1.0, 0.7, 1.4])
    pairs = natural * at * (-zeta + 1j * np.sqrt(1.0 - zeta * zeta))
    poles = np.concatenate((np.exp(-STEP * real), np.exp(STEP * pairs)))
    found, allpass = [np.ones_like(z)], np.ones_like(z)
    for p in poles:
        if p.imag == 0.0:
            found.append(np.sqrt(1.0 - abs(p) ** 2) / (z - p) * allpass)
            allpass = allpass * (1.0 - p.real * z) / (z - p)
        else:
            divisor = (z - p) * (z - p.conj())
            found += [(1.0 - abs(p)) * z / divisor * allpass, (1.0 - abs(p)) / divisor * allpass]
            allpass = allpass * (1.0 - p * z) * (1.0 - p.conj() * z) / divisor
    return np.array(found)


@dataclass(frozen=True)
class Bound:
    """The smallest error in um, its parts, and the loop that has it."""

    error: float
    known: float
    random: float
    ripple: float
    Ms: float
    iterations: int
    unknowns: int
    gap: float
    """Excess of the last law over the bound, as a part of it."""


def bound(loop: Loop, extra: Vector | None = None, is_limited: bool = True) -> Bound:
    """Return the smallest largest load error, by linear programs with cuts.

    Each program is a relaxation, so its optimum is below the bound, and grows with the cuts.

    Args:
        loop: The laws.
        extra: A further error over time, affine in Q, which may be there, with either sign, or not.
        is_limited: Whether ripple and Ms are limited.
    """
    joint, n = loop.joint, loop.sensors
    e = loop.errors if extra is None else np.vstack((loop.errors, loop.errors + extra, loop.errors - extra))
    noises = {0: joint.w_random} | ({3: LOAD_NOISE} if n == 2 else {})
    R_e = loop.gram(0, noises) * PEAK
    R_u = loop.gram(1, {2 + i: 1.0 for i in range(n)})
    allowed = RIPPLE[joint.name] * joint.alpha * 1e-3
    some = np.unique(np.geomspace(8, ROWS // 2, 500).astype(int))
    loops = [loop.affine(2 + i, 2 + i)[some] for i in range(n)]
    scale = 1.0 / np.maximum(np.linalg.norm(R_u[:, 1:], axis=0), 1e-12) * allowed
    scaled = np.concatenate(([1.0], scale))
    e, R_e, R_u, loops = e * scaled, R_e * scaled, R_u * scaled, [x * scaled for x in loops]
    unknowns = e.shape[1] - 1
    cost = np.concatenate((np.zeros(unknowns), [1.0, 1.0]))  # q, largest known error, peak of the random one
    rows, sides = list[Vector](), list[float]()

    def add(row: Vector, known: float = 0.0, random: float = 0.0, most: float = 0.0) -> None:
        """Require row (1, q) <= most + known * gamma + random * s."""
        rows.append(np.concatenate((row[1:], [-known, -random])))
        sides.append(most - row[0])

    x = np.concatenate(([1.0], np.zeros(unknowns)))
    best = 0.0
    for iteration in range(400):
        error, spread, ripple = e @ x, np.linalg.norm(R_e @ x), np.linalg.norm(R_u @ x)
        peaks = [abs(one @ x) for one in loops]
        known, Ms = abs(error).max(), max(p.max() for p in peaks)
        bad = max(ripple / allowed, Ms / MS) - 1.0 if is_limited else 0.0
        if iteration and bad < TOLERANCE and known + spread <= best + max(0.01 * best, 0.005):
            break
        for i in local_peaks(abs(error), 0.8)[:40]:
            add(np.sign(error[i]) * e[i], known=1.0)
        if spread > 0.0:
            add(R_e.T @ (R_e @ x) / spread, random=1.0)
        if is_limited:
            add(R_u.T @ (R_u @ x) / ripple, most=allowed)
            for one, peak in zip(loops, peaks, strict=True):
                for i in local_peaks(peak, 0.98 * MS / max(peak.max(), MS)):
                    value = one[i] @ x
                    add((one[i] * np.conj(value) / abs(value)).real, most=MS)
        solution = linprog(
            cost, np.array(rows), np.array(sides), bounds=[(-50.0, 50.0)] * unknowns + [(0.0, None)] * 2,
            method="highs",
        )  # fmt: skip
        if solution.x is None:
            raise RuntimeError(f"{joint.name}: {solution.message}")
        x, best = np.concatenate(([1.0], solution.x[:unknowns])), solution.fun
    gap = (known + spread - best) / max(best, 1e-9)
    return Bound(best, known, spread, ripple / allowed, Ms, iteration, unknowns, gap)


def local_peaks(values: Vector, fraction: float) -> list[int]:
    """Return the indices of the peaks above a fraction of the largest value, the largest first."""
    inner = np.concatenate(([-np.inf], values, [-np.inf]))
    is_peak = (inner[1:-1] >= inner[:-2]) & (inner[1:-1] >= inner[2:]) & (values >= fraction * values.max())
    found = np.flatnonzero(is_peak)
    return list(found[np.argsort(-values[found])])


def fastest_start(name: str, joint: TwoMasses) -> float:
    """Return the shortest time in s in which the load can join its reference without swing.

    It starts at rest on its spring. The motor has the torque that load and disturbances leave.
    """
    file = load_joint(name)
    emla, reference = file.emla, file.reference
    left = 1e-3 * emla.tau_max * joint.alpha - abs(joint.F_L) / emla.eta_GB - abs(joint.w).max()
    A, B = joint.sampled()
    ms = np.linalg.matrix_power(A, 10), sum(np.linalg.matrix_power(A, i) for i in range(10)) @ B[:, 0]
    distance = reference.q_E - reference.q_S
    T = 15.0 / 8.0 * abs(distance) / reference.v_peak

    def needed(steps: int) -> float:
        r = min(1e-3 * steps / T, 1.0)
        x = 1e6 * (reference.q_S - file.start.x_L + distance * r**3 * (10.0 - 15.0 * r + 6.0 * r * r))
        v = 1e6 * distance / T * 30.0 * (r * (1.0 - r)) ** 2
        columns = [ms[1]]
        for _ in range(steps - 1):
            columns.append(ms[0] @ columns[-1])
        reach = np.array(columns).T
        scale = np.array([1e-3, 1e-5, 1e-3, 1e-5])
        equal = np.hstack((scale[:, None] * reach, np.zeros((4, 1))))
        sides = np.vstack((np.hstack((np.eye(steps), -np.ones((steps, 1)))),
                           np.hstack((-np.eye(steps), -np.ones((steps, 1))))))  # fmt: skip
        found = linprog(
            np.append(np.zeros(steps), 1.0), sides, np.zeros(2 * steps), equal, scale * [x, v, x, v],
            bounds=[(None, None)] * (steps + 1), method="highs",
        )  # fmt: skip
        return np.inf if found.x is None else float(found.fun)

    low, high = 5, 600
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if needed(middle) <= left else (middle, high)
    return 1e-3 * high


GOALS = {"lift": (250.0, 80.0), "tilt": (200.0, 80.0), "telescope": (50.0, 30.0)}
SIMULATED = {"lift": (874.0, 3.0, 2.3), "tilt": (496.0, 4.7, 3.3), "telescope": (65.1, 4.2, 5.4)}
"""Load errors in um without load control, with `motor`, and with `sensor`; docs/load_control.py."""


def bounds(name: str) -> dict[str, Any]:
    """Return all bounds of a joint; lengths in um."""
    joint = TwoMasses.of(name)
    static = abs(joint.F_L) / joint.k
    found: dict[str, Any] = {
        "static deflection": static,
        "start, s": fastest_start(name, joint),
        "stiffness 70 to 130 %": static * 0.5 * (1.0 / 0.7 - 1.0 / 1.3),
    }
    for order in (8, 16, 28):
        loop = Loop(joint, False, order)
        found[f"load known, order {order}"] = vars(bound(loop))
    loop = Loop(joint, False, 16)
    found["load known, no limits"] = vars(bound(loop, is_limited=False))
    found["load known to 10 %"] = vars(bound(loop, loop.unknown_load(0.1 * joint.F_L)))
    found["load unknown"] = vars(bound(loop, loop.unknown_load(joint.F_L)))
    found["load step of 10 %"] = vars(bound(loop, loop.load_step(0.1 * joint.F_L)))
    sensed = Loop(joint, True, 6)
    found["load sensor"] = vars(bound(sensed))
    found["load sensor, load step of 10 %"] = vars(bound(sensed, sensed.load_step(0.1 * joint.F_L)))
    return found


def draw(results: dict[str, dict[str, Any]], path: Path) -> None:
    """Draw bounds, goals and simulated errors."""
    figure = Figure(figsize=(7.5, 3.6), layout="constrained")
    axes = figure.add_subplot()
    tidy_axes(axes)
    axes.set_xlim(-0.5, len(results) - 0.5)
    for i, (name, found) in enumerate(results.items()):
        goal, sensed = GOALS[name]
        without, known, with_sensor = SIMULATED[name]
        points = [
            ("no load control", without, GREY, "o"), ("goal, motor side", goal, BLUE, "_"),
            ("goal, load sensor", sensed, ORANGE, "_"),
            ("bound, load unknown", found["load unknown"]["error"], BLUE, "^"),
            ("bound, load known to 10 %", found["load known to 10 %"]["error"], BLUE, "v"),
            ("bound, load known", found["load known, order 16"]["error"], BLUE, "s"),
            ("bound, load sensor", found["load sensor"]["error"], ORANGE, "s"),
            ("simulated, motor side", known, BLUE, "o"), ("simulated, load sensor", with_sensor, ORANGE, "o"),
        ]  # fmt: skip
        for n, (label, value, color, marker) in enumerate(points):
            x, named = i + 0.08 * (n - 4), None if i else label
            axes.plot(x, value, marker, color=color, markersize=7, label=named)
    axes.set_yscale("log")
    axes.set_xticks(range(len(results)), list(results))
    axes.set_ylabel("load error / um")
    figure.legend(loc="outside right center", frameon=False, fontsize=8)
    figure.savefig(path, dpi=150)


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    everything = {name: bounds(name) for name in RIPPLE}
    (folder / "load-bound.json").write_text(json.dumps(everything, indent=1))
    draw(everything, folder / "load-bound.png")
    for name, found in everything.items():
        for key, value in found.items():
            print(f"{name:10s} {key:32s} {value['error'] if isinstance(value, dict) else value:9.3f}")
