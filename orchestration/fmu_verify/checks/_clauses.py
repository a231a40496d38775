"""Clauses that several modules of checks quote."""

from ..verdict import Clause, fmi3, in_both

SEVERAL = in_both(
    "2.1.5",
    "2.3.1",
    "An FMU can be instantiated many times (provided capability flag "
    "canBeInstantiatedOnlyOncePerProcess = false).",
)
FREED = in_both(
    "2.1.5",
    "2.3.1",
    "Disposes the given instance, unloads the loaded model, and frees all the allocated memory and "
    "other resources that have been allocated by the functions of the FMU interface.",
)
DERIVATIVE = Clause(
    "2.2.7",
    'If present, this variable is the derivative of variable with ScalarVariable index "derivative".',
    in_3=fmi3(
        "2.4.7.5",
        "If present, then the variable with this attribute is the derivative of the variable with value "
        "reference given in derivative.",
    ),
)
INDICES = Clause(
    "2.2.8",
    "Otherwise the Unknown depends on the Knowns defined by the given ScalarVariable indices.",
    in_3=fmi3("2.4.8", "Otherwise the unknown depends on the knowns defined by the given value references."),
)
IN_SCHEMA = fmi3(
    "2.4",
    "All static information related to the core functionality of an FMU is stored in the text file "
    "modelDescription.xml in XML format as specified by the XML schema file "
    "fmi3ModelDescription.xsd.",
)
KEEP_VALUES = fmi3(
    "2.2.7.2",
    "With two exceptions, all variables that are allowed to be set with fmi3Set{VariableType} keep "
    "their respective values until the next call to fmi3Set{VariableType}.",
)
ENUMERATION = fmi3(
    "2.4.7.5",
    "For <Enumeration> the attribute declaredType is required because the <Enumeration> items are "
    "defined in <TypeDefinitions><TypeDefinition>.",
)
