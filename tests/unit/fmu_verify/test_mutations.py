"""A good FMU with one byte, element or attribute changed gives a report, whatever that breaks."""

import random
from copy import deepcopy
from pathlib import Path

import pytest
from lxml import etree

from fmu_verify.catalogue import STATIC
from fmu_verify.settings import Settings
from tests.support.broken.editing import Files, good_bytes, with_files, with_tree
from tests.support.broken.examining import CALLING, examine
from tests.support.broken.static import LIBRARY
from tests.support.tiers import mostly_nightly

CHECKS = (
    *(c.name for c in STATIC if c.name != "sources.compile" and c.only_for != 3),
    "instance.created",
    "run.completes",
)
FILE_CHECKS = tuple(name for name in CHECKS if name not in CALLING or name == "binaries.symbols")
# fmt: off
VALUES = (
    "", "-1", "0", "4294967295", "99999999999999999999", "1e999", "NaN", "-INF", "true", "x" * 10_000, "'",
    "../..", "{é\u2028}", "((((((((((m/s", "1 2 3", "output", "calculated", "Enumeration", "Force",
)
# fmt: on


def archive_byte(chance: random.Random, folder: Path) -> Path:
    content = bytearray(good_bytes())
    content[chance.randrange(len(content))] ^= 1 << chance.randrange(8)
    path = folder / "Toy.fmu"
    path.write_bytes(content)
    return path


def library_byte(chance: random.Random, folder: Path) -> Path:
    def edit(files: Files) -> None:
        content = bytearray(files[LIBRARY])
        content[chance.randrange(len(content))] ^= 1 << chance.randrange(8)
        files[LIBRARY] = bytes(content)

    return with_files(edit)(folder)


def element(chance: random.Random, folder: Path) -> Path:
    """One element is removed, doubled, or moved to the end of its parent."""

    def edit(root: etree._Element) -> None:
        element_ = chance.choice([e for e in root.iter(etree.Element) if e is not root])
        parent = element_.getparent()
        change = chance.choice(("removed", "doubled", "moved"))
        if change == "doubled":
            element_.addnext(deepcopy(element_))
        elif change == "moved":
            parent.append(element_)
        else:
            parent.remove(element_)

    return with_tree(edit)(folder)


def attribute(chance: random.Random, folder: Path) -> Path:
    """One attribute is removed, replaced, or gets the value of another of its name."""

    def edit(root: etree._Element) -> None:
        attributes = [(e, name) for e in root.iter(etree.Element) for name in e.attrib]
        element_, name = chance.choice(attributes)
        change = chance.choice(("removed", "replaced", "another's"))
        if change == "removed":
            del element_.attrib[name]
        elif change == "replaced":
            element_.set(name, chance.choice(VALUES))
        else:
            element_.set(
                name, chance.choice([e.get(name) for e, other_name in attributes if other_name == name])
            )

    return with_tree(edit)(folder)


KINDS = [archive_byte] * 40 + [library_byte] * 20 + [element] * 50 + [attribute] * 90
BY_DEFAULT = range(0, len(KINDS), 10)


@pytest.mark.parametrize("seed", mostly_nightly(range(len(KINDS)), BY_DEFAULT))
def test_mutated_fmu_gets_a_report(seed: int, tmp_path: Path) -> None:
    """Checks that load a changed library run in the nightly tier only."""
    checks = FILE_CHECKS if seed in BY_DEFAULT else CHECKS
    report = examine(KINDS[seed](random.Random(seed), tmp_path), *checks, settings=Settings(seconds=5.0))
    assert tuple(f.check for f in report.findings) == checks
    for finding in report.findings:
        assert not finding.sentence.startswith("The check itself has an error"), finding.sentence
        assert finding.sentence.endswith(".") and "\n" not in finding.sentence, finding.sentence
        assert len(finding.sentence) < 2000, finding.sentence
