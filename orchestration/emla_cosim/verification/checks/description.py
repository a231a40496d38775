"""The model description: readable, and as the schema wants it."""

from functools import cache
from importlib.resources import as_file, files
from typing import Any

from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]

from ..check import check
from ..declarations import find_repeated
from ..messages import judge_problems, shorten_sentence
from ..subject import DESCRIPTION, Subject
from ..verdict import CheckOutcome, Clause, failed, passed

_ROOT = "fmiModelDescription"


@check(
    "description.readable",
    "The model description can be read",
    Clause("2.3", "modelDescription.xml // Description of FMU (required file)"),
    "Export the FMU again; `modelDescription.xml` has to be well-formed XML of FMI 2.0.",
    needs=("archive.safe",),
)
def readable(subject: Subject) -> CheckOutcome:
    """There is one, it is XML of FMI 2.0, and says what the FMU is for."""
    if not (subject.folder / DESCRIPTION).is_file():
        return failed(f"It has no {DESCRIPTION}.")
    try:
        root = subject.tree
    except MemoryError:
        raise
    except Exception as error:  # lxml has its own, and what it is given is hostile
        return failed(f"{DESCRIPTION} cannot be read: {shorten_sentence(str(error)).rstrip('.')}.")
    if root.tag != _ROOT:
        return failed(
            shorten_sentence(f"{DESCRIPTION} begins with the element {root.tag}; it should be {_ROOT}.")
        )
    version = root.get("fmiVersion")
    if version != "2.0":
        return _other_version(version)
    if root.getroottree().docinfo.internalDTD is not None:
        return failed(f"{DESCRIPTION} has a document type definition, which the FMI does not know.")
    if not subject.kinds:
        return failed(f"{DESCRIPTION} has neither a CoSimulation nor a ModelExchange element.")
    return passed(
        shorten_sentence(f"It describes {root.get('modelName')}, for {' and '.join(subject.kinds)}.")
    )


def _other_version(version: str | None) -> CheckOutcome:
    if version is None:
        return failed(f"{DESCRIPTION} does not say of which version of the FMI it is (fmiVersion).")
    return failed(
        shorten_sentence(f"It is an FMI {version} FMU; this verifies FMI 2.0."),
        hint="Use a tool for its version of the FMI, or export the model for FMI 2.0.",
    )


@check(
    "description.schema",
    "The model description is as the schema wants it",
    Clause("2.2", "The normative definition are the above mentioned schema files."),
    "The lines are those of `modelDescription.xml`; the schema files come with the standard.",
    needs=("description.readable",),
)
def schema(subject: Subject) -> CheckOutcome:
    """It validates against the XML schema of FMI 2.0."""
    found = _schema()
    found.validate(subject.tree)
    problems = [f"Line {e.line}: {e.message.strip().rstrip('.')}." for e in found.error_log]
    return judge_problems(problems, "It is valid by the XML schema of FMI 2.0.")


@cache
def _schema() -> Any:
    with as_file(files("fmpy") / "schema" / "fmi2") as folder:
        return etree.XMLSchema(file=str(folder / "fmi2ModelDescription.xsd"))


@check(
    "description.encoding",
    "The model description is in UTF-8",
    Clause("2.2", "It is required that the encoding scheme is always UTF-8:"),
    'Write the file in UTF-8, with `<?xml version="1.0" encoding="UTF-8"?>` as its first line.',
    needs=("description.readable",),
)
def encoding(subject: Subject) -> CheckOutcome:
    """It is in UTF-8, and says so."""
    said = subject.tree.getroottree().docinfo.encoding or "UTF-8"
    start = (subject.folder / DESCRIPTION).read_bytes()[:200]
    if said.upper() not in ("UTF-8", "UTF8"):
        return failed(shorten_sentence(f"It is in {said}."))
    if b"encoding" not in start.partition(b"?>")[0]:
        return judge_problems((), "", ["Its first line does not say how it is encoded."])
    return passed("It is in UTF-8.")


@check(
    "description.capabilities",
    "What it claims goes together",
    Clause("4.3.1", "If this is the case, then flag canGetAndSetFMUstate must be true as well."),
    "An FMU that serializes its state has to give and take it too.",
    needs=("description.schema",),
)
def capabilities(subject: Subject) -> CheckOutcome:
    """Nothing is claimed that needs a capability which is not."""
    elements = [(kind, subject.tree.find(kind)) for kind in subject.kinds]
    problems = [
        f"{kind} claims canSerializeFMUstate, but not canGetAndSetFMUstate."
        for kind, element in elements
        if _true(element, "canSerializeFMUstate") and not _true(element, "canGetAndSetFMUstate")
    ]
    return judge_problems(problems, "What it claims goes together.")


def _true(element: Any, flag: str) -> bool:
    return element.get(flag, "false").strip() in ("true", "1")


@check(
    "description.categories",
    "Log categories have names of their own",
    Clause(
        "2.2.4",
        'The "name" attribute of "Category" must be unique with respect to all other elements of the '
        "LogCategories list.",
    ),
    "Leave one of the categories out.",
    needs=("description.schema",),
)
def categories(subject: Subject) -> CheckOutcome:
    """No two log categories have the same name."""
    names = [e.get("name") for e in subject.tree.iterfind("LogCategories/Category")]
    problems = [f"More than one log category is called {name}." for name in find_repeated(names)]
    return judge_problems(problems, f"{len(names)} log categories have different names.")


@check(
    "description.identifier",
    "The model identifier can name C functions",
    Clause("fmi2ModelDescription.xsd", 'Short class name according to C-syntax, e.g. "A_B_C".'),
    "Use letters, digits and underscores only, and no digit first.",
    needs=("description.schema",),
)
def identifier(subject: Subject) -> CheckOutcome:
    """The modelIdentifier is a name of the language C, and so no path either."""
    given = {kind: subject.tree.find(kind).get("modelIdentifier") for kind in subject.kinds}
    problems = [
        f"The modelIdentifier '{name}' of {kind} is no name of the language C."
        for kind, name in given.items()
        if not (name.isascii() and name.isidentifier())
    ]
    return judge_problems(problems, shorten_sentence(f"It is {' and '.join(sorted(set(given.values())))}."))
