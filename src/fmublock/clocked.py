"""The periodic input clock of a block in the model description for FMI 3.0."""

from xml.etree.ElementTree import Element

_PARAMETERS = ("parameter", "independent")


def add_clock(variables: Element, structure: Element, interval: float) -> None:
    """Add a clock: all variables but parameters, constants and the time belong to it.

    Its value reference follows that of the time, the last variable. The first tick is one interval after the
    start. Each output can depend on all inputs, because a tick is a whole step.

    Args:
        variables: The element ModelVariables, without derivatives.
        structure: The element ModelStructure.
        interval: The interval in s.
    """
    reference = str(int(variables[-1].get("valueReference", "")) + 1)
    names, name = {v.get("name") for v in variables}, "clock"
    while name in names:
        name += "_"
    for variable in variables:
        if variable.get("causality") in _PARAMETERS or variable.get("variability") == "constant":
            continue
        variable.set("variability", "discrete")
        variable.set("clocks", reference)
        variable.attrib.pop("intermediateUpdate", None)
    attributes = {
        "name": name,
        "valueReference": reference,
        "description": "Ticks of the block",
        "causality": "input",
        "intervalVariability": "constant",
        "intervalDecimal": repr(float(interval)),
        "shiftDecimal": repr(float(interval)),
    }
    variables.append(Element("Clock", attributes))
    for unknown in list(structure):
        if unknown.tag != "Output":
            structure.remove(unknown)
        unknown.attrib.pop("dependencies", None)
