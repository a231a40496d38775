"""The stepper in plain Python: the simplest text that is right, as an oracle for the one in C.

It works on the memory of an algorithm and its network, and calls the methods of instances.
"""

import math
import time as clock
from collections.abc import Sequence
from typing import Any

import numpy as np

from emla_cosim.master.algorithms.algorithm import Algorithm
from emla_cosim.master.algorithms.extrapolation import Known, Mode
from emla_cosim.master.algorithms.group import HALVINGS, SWEEPS, CoupledGroup
from emla_cosim.master.algorithms.newton import FILTER, NOISE, RELAXATION
from emla_cosim.master.algorithms.program import PREVIOUS, SIGNALS, Call, Combine, Operation, Solve
from emla_cosim.master.instances.fmu_instance import DiscardedStepError
from emla_cosim.master.stepping.step_size_control import FixedSteps, StepRequest, StepSizeControl
from emla_cosim.master.stepping.stepping_base import LONGEST, RowSink, Stepping
from emla_cosim.master.stepping.timing import CommunicationPoints
from fmublock.table import SPANS


class NoAgreementError(Exception):
    """The values of a group differ by this after so many sweeps."""


class PlainStepper:
    """Does the steps of an algorithm after its `initialize`; `divides` does discarded steps in halves."""

    def __init__(self, algorithm: Algorithm, divides: bool = False) -> None:
        instances = algorithm.network.instances
        self.divides = divides and all(s.rolls_back and not s.restarts_when_saved for s in instances)
        self.algorithm, self.network = algorithm, algorithm.network
        self.exchange, self.history = algorithm.exchange, algorithm.exchange.history
        self.states: dict[tuple[int, int], Any] = {}
        self.coupling_tolerance = algorithm.coupling_tolerance
        self.discarding = -1
        """Member of a group that has stepped last."""
        self.divisions = np.tile([0.0, np.inf], (len(self.network.instances), 1))
        """Steps that each instance discarded and did in parts, and the shortest part in s."""

    def step(self, time: float, length: float, times: CommunicationPoints | None = None) -> None:
        """Do one step, in s. With step multiples, `times` has the points of the long steps."""
        algorithm, reached = self.algorithm, self.algorithm.steps + 1
        self.network.pass_opaque_values()
        if algorithm.groups:
            self.see()
        groups = iter(algorithm.groups)
        for each in algorithm.program:
            if isinstance(each, Combine):
                part = self.network.parts[each.instance]
                terms = [factor * self.vector(name)[part] for name, factor in each.terms.items()]
                self.vector(each.into)[part] = sum(terms[1:], terms[0])
            elif isinstance(each, Solve):
                self.solve(next(groups), time, length)
            elif reached % (multiple := int(algorithm.multiples[each.instance])) == 0:
                begin, span = (time, length) if times is None else stretch(times, reached, multiple)
                self.call(each, begin, span, time + length)
        algorithm.steps = reached

    def see(self) -> None:
        """Update the largest values with the present signals."""
        sizes, largest = np.abs(self.network.signals), self.algorithm.scale.largest
        np.fmax(largest, sizes, out=largest, where=np.isfinite(sizes))

    def vector(self, name: str) -> np.ndarray:
        vectors = {SIGNALS: self.network.signals, PREVIOUS: self.history.previous}
        return vectors[name] if name in vectors else self.algorithm.stores[name]

    def call(self, operation: Operation, begin: float, span: float, end: float) -> None:
        instance = self.network.instances[operation.instance]
        if operation.call == Call.STEP:
            self.do_step(operation.instance, begin, span)
        elif operation.call == Call.GET:
            self.shift(operation.instance, end)
            self.get_outputs(operation.instance)
        elif operation.store == SIGNALS:
            self.set_inputs(operation.instance, begin, span)
        else:
            instance.inputs[:] = self.vector(operation.store)[self.network.sources[operation.instance]]
            self.network.transform(operation.instance)
            instance.set_inputs()

    def do_step(self, i: int, time: float, length: float, halvings: int = HALVINGS) -> None:
        """Do a step of an instance, in halves if it discards it. Inputs then move along their lines."""
        instance, part = self.network.instances[i], self.network.input_parts[i]
        can_halve = instance.varies_step and self.divides
        state = instance.save() if can_halve else None
        try:
            instance.do_step(time, length)
            if halvings < HALVINGS and self.exchange.has_slopes(i):
                instance.inputs[:] += length * self.exchange.derivatives[part]
        except DiscardedStepError as failure:
            if not can_halve or not halvings:
                raise
            instance.restore(state)
            middle, end = time + 0.5 * length, time + length
            self.note_division(i, middle - time, halvings == HALVINGS)
            for begin, span in ((time, middle - time), (middle, end - middle)):
                instance.set_inputs()
                if self.exchange.has_slopes(i):
                    instance.set_input_derivatives(self.exchange.derivatives[part])
                try:
                    self.do_step(i, begin, span, halvings - 1)
                except DiscardedStepError:
                    raise failure from None  # that of the whole step
        finally:
            if state is not None:
                instance.forget(state)

    def note_division(self, i: int, length: float, is_first: bool) -> None:
        self.divisions[i, 0] += is_first
        self.divisions[i, 1] = min(self.divisions[i, 1], length)

    # ---- the exchange of values ----

    def set_inputs(self, i: int, time: float, length: float) -> None:
        """Set the inputs of an instance: held, at the middle of a line, or along it."""
        network, history, exchange, mode = self.network, self.history, self.exchange, self.exchange.modes[i]
        if mode == Mode.HOLD and not exchange.reads_known_signal(i):
            network.pass_inputs(i)
            return
        instance, part = network.instances[i], network.input_parts[i]
        for j, signal in enumerate(network.sources[i]):
            owner, index = exchange.owners[signal], part.start + j
            if exchange.readings[i][j] or mode == Mode.HOLD:
                value, slope = float(network.signals[signal]), 0.0
                if exchange.readings[i][j]:
                    value, slope = self.read_known(int(exchange.readings[i][j]), signal, time, length)
                instance.inputs[j] = network.factors[i][j] * value + network.offsets[i][j]
                exchange.derivatives[index] = network.factors[i][j] * slope
                continue
            earlier, then = history.previous[signal], history.before[owner]
            if exchange.rare[i]:
                if history.last_read_at[index] < then:
                    earlier, then = history.last_read[index], history.last_read_at[index]
                history.last_read[index], history.last_read_at[index] = (
                    network.signals[signal],
                    history.at[owner],
                )
            moves = exchange.smooth[signal] and instance.continuous_inputs[j] and history.at[owner] > then
            slope = (network.signals[signal] - earlier) / (history.at[owner] - then) if moves else 0.0
            ahead = time - history.at[owner] + (0.5 * length if mode == Mode.MIDDLE else 0.0)
            value = network.signals[signal] + ahead * slope
            instance.inputs[j] = network.factors[i][j] * value + network.offsets[i][j]
            exchange.derivatives[index] = network.factors[i][j] * slope
        instance.set_inputs()
        if exchange.has_slopes(i):
            instance.set_input_derivatives(exchange.derivatives[part])

    def read_known(self, order: int, signal: int, time: float, length: float) -> tuple[float, float]:
        """Return what an input reads of a known signal, and its slope."""
        owner, history = self.exchange.owners[signal], self.history
        then, span = history.before[owner], history.at[owner] - history.before[owner]
        begin, end, mean = (self.algorithm.stores[f"{x} of step"][signal] for x in ("begin", "end", "mean"))
        if order == Known.SAMPLE or not span > 0.0:
            return float(self.network.signals[signal]), 0.0
        if order == Known.BEGIN:
            return float(history.previous[signal]), 0.0
        slope = (end - begin) / span
        if order == Known.MEAN:
            return (begin + (time - then + 0.5 * length) * slope if length < 0.75 * span else mean), 0.0
        return begin + (time - then) * slope, slope

    def get_outputs(self, i: int) -> None:
        """Get outputs of an instance; those that follow known inputs, after these are set to the end."""
        instance, part = self.network.instances[i], self.network.parts[i]
        instance.get_outputs()
        if i in self.algorithm.known_sources and instance.span_references:
            for span in SPANS:
                names = [f"step.{span}.{v.name}" for v in instance.written]
                values = [instance.value(instance.file.variables[name]) for name in names]
                self.algorithm.stores[f"{span} of step"][part] = values
        if self.exchange.follows[i]:
            for j, signal in enumerate(self.network.sources[i]):
                if self.exchange.readings[i][j] == Known.MEAN:
                    factor, offset = self.network.factors[i][j], self.network.offsets[i][j]
                    instance.inputs[j] = factor * self.network.signals[signal] + offset
            instance.set_inputs()
            instance.get_outputs()

    def predict(self, signal: int, time: float) -> float:
        """Return a signal, extrapolated to a time in s."""
        history, owner, now = self.history, self.exchange.owners[signal], self.network.signals[signal]
        span = history.at[owner] - history.before[owner]
        moves = self.exchange.smooth[signal] and span > 0.0
        slope = (now - history.previous[signal]) / span if moves else 0.0
        return float(now + (time - history.at[owner]) * slope)

    def shift(self, i: int, time: float) -> None:
        """Move the signals of an instance to the history, before those of `time`."""
        part = self.network.parts[i]
        self.history.previous[part] = self.network.signals[part]
        self.history.before[i], self.history.at[i] = self.history.at[i], time

    # ---- loops ----

    def solve(self, group: CoupledGroup, time: float, length: float, halvings: int = HALVINGS) -> None:
        """Bring a group to the end of a step, in halves if one step fails."""
        saved = [self.network.signals, self.history.previous, self.history.at, self.history.before]
        copies = [values.copy() for values in saved]
        if group.is_saved:
            self.save(group)
        try:
            self.iterate(group, time, length)
        except (DiscardedStepError, NoAgreementError) as failure:
            if not group.is_saved or not group.is_halved or not halvings:
                if isinstance(failure, NoAgreementError):
                    raise group.make_disagreement_error(time, length, *failure.args) from failure
                raise
            self.restore(group)
            middle, end = time + 0.5 * length, time + length
            if isinstance(failure, DiscardedStepError):
                self.note_division(self.discarding, middle - time, halvings == HALVINGS)
            for i in group.members:
                part = self.network.parts[i]
                for values, copy, where in zip(saved, copies, (part, part, i, i), strict=True):
                    values[where] = copy[where]
            self.solve(group, time, middle - time, halvings - 1)
            self.solve(group, middle, end - middle, halvings - 1)

    def save(self, group: CoupledGroup) -> None:
        for i in group.members:
            key = id(group), i
            self.states[key] = self.network.instances[i].save(self.states.get(key))

    def restore(self, group: CoupledGroup) -> None:
        for i in group.members:
            self.network.instances[i].restore(self.states[id(group), i])

    def sweep(self, group: CoupledGroup, time: float, length: float) -> None:
        for i in group.members:
            self.set_inputs(i, time, length)
            self.discarding = i
            self.network.instances[i].do_step(time, length)
            self.get_outputs(i)

    def iterate(self, group: CoupledGroup, time: float, length: float) -> None:
        """Do sweeps until the values agree; see `quasi_newton.py`."""
        signals, which = self.network.signals, group.coupling_variables
        guess = np.array([self.predict(signal, time + length) for signal in which])
        for i in group.members:
            self.shift(i, time + length)
        if not group.is_saved or not len(which):
            self.sweep(group, time, length)
            return
        sizes, jacobian = group.scale.sizes(which), group.jacobian
        earlier, residuals, answers = jacobian.copy(), list[np.ndarray](), list[np.ndarray]()
        for k in range(SWEEPS):
            if k:
                self.restore(group)
            signals[which] = guess
            self.sweep(group, time, length)
            self.algorithm.sweeps += 1
            answers.append(signals[which].copy())
            residuals.append(answers[-1] - guess)
            agreed = bool((np.abs(residuals[-1]) / sizes <= self.coupling_tolerance).all())
            if not np.isfinite(residuals[-1]).all():
                break
            if 0 < k <= len(which) or not agreed:
                guess = improve(residuals, answers, sizes, earlier, jacobian)
            if agreed:
                return
        jacobian[:] = np.eye(len(which)) * (1.0 - RELAXATION)
        raise NoAgreementError(residuals[-1], len(residuals))

    def close(self) -> None:
        """Free the saved states."""
        for (_, i), state in self.states.items():
            self.network.instances[i].forget(state)
        self.states.clear()


def improve(
    residuals: Sequence[np.ndarray],
    answers: Sequence[np.ndarray],
    sizes: np.ndarray,
    earlier: np.ndarray,
    jacobian: np.ndarray,
) -> np.ndarray:
    """Learn J from all sweeps of a step, and return the next guess. Sums are in the order of the terms."""
    jacobian[:] = earlier
    largest = max(_dot(x / sizes, x / sizes) for x in residuals)
    basis = list[np.ndarray]()
    for k in range(len(residuals) - 1, 0, -1):
        direction = residuals[k] / sizes - residuals[k - 1] / sizes
        square = _dot(direction, direction)
        if len(basis) == len(sizes) or not square > NOISE * NOISE * largest:
            continue
        for unit in basis:
            direction = direction - _dot(unit, direction) / _dot(unit, unit) * unit
        rest = _dot(direction, direction)
        if not rest > FILTER * FILTER * square:
            continue
        basis.append(direction)
        unexplained = _minus(answers[k] - answers[k - 1], jacobian, residuals[k] - residuals[k - 1])
        for i, value in enumerate(unexplained):
            jacobian[i] += value / rest * direction / sizes
    return _minus(answers[-1], jacobian, residuals[-1])


def _dot(a: np.ndarray, b: np.ndarray) -> float:
    total = 0.0
    for x, y in zip(a, b, strict=True):
        total += float(x * y)
    return total


def _minus(answer: np.ndarray, jacobian: np.ndarray, residual: np.ndarray) -> np.ndarray:
    """Return answer - J residual, one term after the other."""
    difference = answer.copy()
    for j, value in enumerate(residual):
        difference = difference - jacobian[:, j] * value
    return difference


def stretch(times: CommunicationPoints, k: int, count: int) -> tuple[float, float]:
    """Return start and length in s of the `count` steps up to communication point k."""
    begin = times.point(k - count)
    return begin, times.point(k) - begin


class PlainSteps(FixedSteps):
    """Steps of one length by the plain stepper."""

    stepper: PlainStepper | None = None

    def advance(self, rows: RowSink, most: int, until: float = math.inf) -> None:
        algorithm, times, ends = self.algorithm, self.times, clock.monotonic() + LONGEST
        self.stepper = self.stepper or PlainStepper(algorithm, divides=True)
        for k in range(self.steps, min(self.steps + most, self._find_last_step(until))):
            self.stepper.step(*stretch(times, k + 1, 1), times)
            if (failure := algorithm.network.find_nonfinite_signal(times.point(k + 1))) is not None:
                algorithm.steps = k
                raise failure
            if (k + 1) % rows.steps_per_row == 0:
                self.record(rows, algorithm.network.observer.is_due(k + 1))
            if clock.monotonic() > ends:
                return

    def state_dict(self) -> dict[str, Any]:
        self.report()
        return super().state_dict()

    def report(self) -> dict[str, Any]:
        if self.stepper is not None:
            self.loop.divisions["steps"], self.loop.divisions["shortest"] = self.stepper.divisions.T
        return super().report()

    def close(self) -> None:
        if self.stepper is not None:
            self.stepper.close()
        super().close()


class PlainStepSize(StepSizeControl):
    """The step-size control of `PlainSteps`, for the option of this name of a run."""

    is_regular = True

    def make_stepping(self, algorithm: Any, request: StepRequest) -> Stepping:
        return PlainSteps(algorithm, request.times)
