"""Write the tables of variables into the FMUs' READMEs: `python -m fmus.make_tables`."""

from pathlib import Path

from emla_cosim.fmu.models import MODELS
from fmublock.documentation import with_variables

FMUS = Path(__file__).parent


def readme(model: str) -> Path:
    """Return the path of a model's README."""
    return FMUS / model / "README.md"


def page(model: str) -> str:
    """Return a README's own text with the present table of variables."""
    return with_variables(readme(model).read_text(encoding="utf-8"), MODELS[model])


def main() -> None:
    """Write the READMEs of all models."""
    for model in MODELS:
        readme(model).write_text(page(model), encoding="utf-8", newline="\n")


if __name__ == "__main__":
    main()
