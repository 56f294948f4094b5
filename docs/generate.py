"""Pages that are made, not written: the command line, the keys of scenarios, the Python reference, the gallery.

`make docs` runs this before Sphinx. The gallery's pictures are made by running the scenarios that it names; with
``--no-pictures`` (for a quick look at the text) it names them only.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent
sys.path.insert(0, str(ROOT))  # the testbench of this checkout, installed or not
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(ROOT)}


class Shown(NamedTuple):
    """One picture: the command that makes it, where it lies below the results folder, and what it shows."""

    command: str
    picture: str
    words: str


GALLERY = (
    Shown("run eolo_alpha", "eolo_alpha/figures/input_de.png", "An elevator 3-2-1-1 against the modes of eolo."),
    Shown("run eolo_alpha", "eolo_alpha/figures/poles.png", "Poles identified without and with an alpha vane."),
    Shown("run b1_alpha", "b1_alpha/figures/poles.png", "The same on the B-1-like surrogate."),
    Shown("run taurus_doublet", "taurus_doublet/figures/poles.png", "Poles that wander: 2 s doublets seen at 8 Hz."),
    Shown(
        "run eolo_methods", "eolo_methods/figures/parameters.png", "Derivatives by several estimators and the truth."
    ),
    Shown("aircraft eolo", "aircraft_eolo/figures/three_view.png", "Three views of eolo."),
    Shown("aircraft eolo", "aircraft_eolo/figures/mode_shapes.png", "Its elastic modes."),
    Shown(
        "aircraft eolo", "aircraft_eolo/figures/modes_longitudinal.png", "Its modes over speed, and where it flutters."
    ),
    Shown(
        "design eolo_short_period",
        "design_eolo_short_period/figures/spectra.png",
        "Designed inputs beside classic ones.",
    ),
    Shown("design eolo_short_period", "design_eolo_short_period/figures/errors.png", "What each of them would tell."),
    Shown(
        "gap flexible_wings", "gap_flexible_wings/figures/residual_maps.png", "Where simulation and flight disagree."
    ),
    Shown(
        "gap flexible_wings", "gap_flexible_wings/figures/held_out_1.png", "Before and after the named effect is added."
    ),
)


# --- commands ---------------------------------------------------------------------------------------------------------


def commands_page() -> str:
    """Return the command line's reference as Markdown, from the program's own help."""
    done = subprocess.run(
        [sys.executable, "-m", "typer", "testbench.cli", "utils", "docs", "--name", "testbench"],
        cwd=ROOT, env=ENVIRONMENT, capture_output=True, text=True, check=True,
    )  # fmt: skip
    text = done.stdout.replace("# `testbench`", "# Commands", 1)
    return text.replace("\n# CLI\n", "\n# Commands\n")


# --- scenarios --------------------------------------------------------------------------------------------------------


def models(model: type[BaseModel], seen: list[type[BaseModel]]) -> None:
    """Collect ``model`` and every model that its fields hold, depth first."""
    if model in seen:
        return
    seen.append(model)
    for field in model.model_fields.values():
        for inner in _models_in(field.annotation):
            models(inner, seen)


def _models_in(annotation: Any) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for argument in get_args(annotation):
        yield from _models_in(argument)


def scenarios_page() -> str:
    """Return every key of every kind of scenario, from the schema that checks them."""
    from testbench.questions.files import WITH_FILES, file_classes
    from testbench.sensors.suite import any_entry, kind_rows

    commands = {question.kind: f": `testbench {question.command}`" for question in WITH_FILES}
    out = [
        "# Keys of scenario files",
        "",
        "Scenario files are TOML. A key that is not listed is refused with the nearest one that is; units are in the "
        "names. `testbench check FILE` says every fault of a file at once. Ranges refuse what cannot be, not what is "
        "unusual; `testbench schema` gives all of this as JSON schemas, for editors and programs.",
    ]
    seen: list[type[BaseModel]] = []
    for kind, file_class in file_classes().items():
        before = len(seen)
        models(file_class, seen)
        out += ["", f"## {kind[0].upper()}{kind[1:]}{commands.get(kind, '')}"]
        for model in seen[before:]:
            out += [
                "",
                f"### {model.__name__}",
                "",
                _summary(model),
                "",
                "| key | value | range | default |",
                "|---|---|---|---|",
            ]
            schema = model.model_json_schema()
            own = schema.get("properties") or schema["$defs"][model.__name__]["properties"]  # of one that holds itself
            out += [_row(name, field, own[name]) for name, field in model.model_fields.items()]
            if model is any_entry():
                out += [
                    "",
                    "A `kind` says what a real instrument feels; without one it reads its channel as it is.",
                    "",
                ]
                out += ["| kind | channels | keys that only it has | what it is |", "|---|---|---|---|"]
                out += [f"| `{name}` | {reads} | {keys} | {words} |" for name, reads, keys, words in kind_rows()]
    return "\n".join(out) + "\n"


def questions_page() -> str:
    """Return the table of questions, and the function of each with its docstring."""
    from testbench.questions import QUESTIONS

    out = ["# Questions", "", "Each with its command, its files and its Python function.", ""]
    out += ["| command | what it does | file | packaged files |", "|---|---|---|---|"]
    for q in QUESTIONS:
        folder = f"`scenarios/{q.folder}`".replace("/`", "`") if q.kind else ""
        out.append(f"| `testbench {q.command}` | {q.words} | {q.kind} | {folder} |")
    for q in QUESTIONS:
        module, name = q.function.split(":")
        out += ["", f"## {q.command}", "", "```{eval-rst}", f".. automodule:: {q.package}", "   :no-members:", ""]
        out += [f".. autofunction:: {q.package}.{module}.{name}", "```"]
    return "\n".join(out) + "\n"


def _summary(model: type[BaseModel]) -> str:
    return " ".join((model.__doc__ or "").split("\n\n")[0].split())


def _row(name: str, field: FieldInfo, schema: dict[str, Any]) -> str:
    default = "required" if field.is_required() else f"`{_default(field)}`"
    limits = f"{_range(schema)} {schema.get('unit', '1')}".removesuffix(" 1")
    return f"| `{name}` | {_type(field.annotation)} | {limits} | {default} |"


def _range(schema: Any) -> str:
    """Return the range of the first number in a JSON schema, "" if there is none."""
    if not isinstance(schema, dict):
        return next(filter(None, map(_range, schema)), "") if isinstance(schema, list) else ""
    if schema.get("type") in ("number", "integer"):
        low = f"above {schema['exclusiveMinimum']:g}" if "exclusiveMinimum" in schema else f"{schema['minimum']:g}"
        high = f"below {schema['exclusiveMaximum']:g}" if "exclusiveMaximum" in schema else f"to {schema['maximum']:g}"
        return f"{low} {high}".replace("above 0 to", "above 0, to")
    return next(filter(None, map(_range, (v for k, v in schema.items() if k != "$defs"))), "")


def _default(field: FieldInfo) -> str:
    value = field.get_default(call_default_factory=True)  # type: ignore[call-arg]
    if isinstance(value, BaseModel):
        return "{}"
    text = repr(value).replace("'", '"')
    return text if len(text) <= 40 else text[:37] + "..."


def _type(annotation: Any) -> str:
    inner = list(dict.fromkeys(m.__name__ for m in _models_in(annotation)))
    if inner:
        many = (
            "list of "
            if get_origin(annotation) in (tuple, list)
            else "table of "
            if get_origin(annotation) is dict
            else ""
        )
        return many + " or ".join(inner)
    arguments = [a for a in get_args(annotation) if a is not type(None)]
    if get_origin(annotation) in (tuple, list):
        return "list of " + " or ".join(dict.fromkeys(_type(a) for a in arguments if a is not Ellipsis))
    if get_origin(annotation) is dict:
        return f"table of {_type(arguments[1])}"
    if arguments and all(isinstance(a, str) for a in arguments):
        return ", ".join(f'"{a}"' for a in arguments)
    if arguments and hasattr(annotation, "__metadata__"):
        return _type(arguments[0])
    if arguments:
        return " or ".join(dict.fromkeys(_type(a) for a in arguments))
    return {float: "number", int: "whole number", str: "text", bool: "true or false"}.get(annotation, "")


# --- gallery ----------------------------------------------------------------------------------------------------------


def gallery_page(pictures: bool) -> str:
    """Run what makes the pictures, copy them beside the page, and return the page."""
    out = ["# Gallery", "", "Every picture is made by a scenario of the repository; the command stands below it."]
    folder = HERE / "_gallery"
    if pictures:
        folder.mkdir(exist_ok=True)
        with tempfile.TemporaryDirectory() as results:
            for command in dict.fromkeys(s.command for s in GALLERY):
                print(f"testbench {command}", flush=True)
                code = "from testbench.cli import main; main()"
                subprocess.run([sys.executable, "-c", code, *command.split(), "-o", results], cwd=ROOT, env=ENVIRONMENT,
                               check=True, stdout=subprocess.DEVNULL)  # fmt: skip
            for shown in GALLERY:
                shutil.copy(Path(results) / shown.picture, folder / shown.picture.replace("/", "_"))
    for shown in GALLERY:
        name = shown.picture.replace("/", "_")
        if (folder / name).is_file():
            out += ["", f"![{shown.words}](_gallery/{name})"]
        out += ["", f"*{shown.words}* `testbench {shown.command}` draws `{shown.picture}`."]
    return "\n".join(out) + "\n"


REFERENCE = {"commands.md": commands_page, "scenarios.md": scenarios_page, "questions.md": questions_page}
"""Pages that are committed; tests/docs/test_reference.py holds them against what the program says."""


def main() -> None:
    """Write all made pages."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--no-pictures", action="store_true", help="do not run the scenarios of the gallery")
    parser.add_argument("--reference", action="store_true", help="only the pages that are committed: the reference")
    given = parser.parse_args()
    for name, page in REFERENCE.items():
        (HERE / "reference" / name).write_text(page(), encoding="utf-8")
    if given.reference:
        return
    (HERE / "gallery.md").write_text(gallery_page(not given.no_pictures), encoding="utf-8")


if __name__ == "__main__":
    main()
