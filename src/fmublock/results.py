"""Check the results of a block's methods against its declarations."""

from typing import Any

from .block import Block
from .functions import Symbolic
from .variables import Variable

METHODS = {"derivatives": "states", "update": "discrete_states", "outputs": "outputs"}
"""The methods of a block in the order of a step, and the kind of variables that each computes."""


class EquationError(Exception):
    """The results of a block's equations do not match its declarations."""


class Results:
    """Converts the results of a block's method: `derivatives`, `update` or `outputs`.

    `attributes` has the attribute that each element of the results belongs to.
    """

    def __init__(self, block: Block, method: str) -> None:
        self._variables: tuple[Variable, ...] = getattr(block.layout(), METHODS[method])
        self.attributes = [x.attribute for x in self._variables for _ in x.scalars()]
        self._expected = set(self.attributes)
        self._method = f"{type(block).__name__}.{method}"

    def flat(self, values: Any) -> list[Any]:
        """Return the results as one list of floats or symbols in the order of their value references.

        Raises:
            EquationError: A value is missing, is not a number, or belongs to no variable that the method
                computes.
        """
        if not isinstance(values, dict):
            raise EquationError(f"{self._method} returns {values!r} instead of a dict of results.")
        if values.keys() != self._expected:
            raise EquationError(self._wrong_names(values))
        found: list[Any] = []
        for variable in self._variables:
            value = values[variable.attribute]
            if type(value) is float and not variable.shape:  # by far the most frequent case
                found.append(value)
            else:
                found += self._elements(variable, value)
        return found

    def _elements(self, variable: Variable, value: Any) -> list[Any]:
        vector = type(value) is list and variable.shape == (len(value),)
        try:
            elements = value if vector else variable.flat(value)
        except ValueError as error:
            raise EquationError(f"{self._method}: {variable.attribute} is wrong: {error}.") from None
        return [x if type(x) is float else _number(self._method, variable.attribute, x) for x in elements]

    def _wrong_names(self, values: dict[str, Any]) -> str:
        if unknown := [str(name) for name in values if name not in self._expected]:
            return f"{self._method} returns {', '.join(unknown)}, not declared as such."
        missing = [x.attribute for x in self._variables if x.attribute not in values]
        return f"{self._method} returns no value for {', '.join(missing)}."


class Conditions:
    """Converts the results of a block's `conditions`; `attributes` are the messages."""

    def __init__(self, block: Block) -> None:
        self.attributes: list[str] = []
        self._method = f"{type(block).__name__}.conditions"

    def flat(self, values: Any) -> list[Any]:
        """Return whether each condition holds, as numbers or symbols.

        Raises:
            EquationError: The values are not a dict from messages to comparisons.
        """
        if not isinstance(values, dict) or not all(isinstance(message, str) for message in values):
            raise EquationError(f"{self._method} returns {values!r} instead of a dict of conditions.")
        self.attributes = list(values)
        return [_number(self._method, f"'{sentence}'", value) for sentence, value in values.items()]


def _number(method: str, name: str, value: Any) -> Any:
    if isinstance(value, Symbolic):
        return value
    if isinstance(value, (float, int)):
        return float(value)
    raise EquationError(f"{method}: {name} is {value!r}, which is not a number.")
