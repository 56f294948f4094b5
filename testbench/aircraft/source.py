"""A JSBSim model as somebody wrote it: found, read with everything that it includes, and made one piece.

JSBSim looks for included files in several folders beside the model and below its own root directory. What is read here
is one tree without includes, and the files of engines and thrusters, so that it can be changed and flown anywhere.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from testbench.core.door import read_text, read_xml
from testbench.core.errors import ModelError, RecordError
from testbench.core.paths import holds_jsbsim_model, stock_root

_INCLUDES = (
    "metrics",
    "mass_balance",
    "buoyant_forces",
    "ground_reactions",
    "external_reactions",
    "propulsion",
    "system",
    "autopilot",
    "flight_control",
    "aerodynamics",
)
_LEFT_OUT = ("input", "output")  # sockets and files: a flight is recorded by whoever flies it


@dataclass(frozen=True)
class Source:
    """A JSBSim model in one piece."""

    name: str  # of the model
    path: Path  # of its main file
    xml: str  # the model without includes, as text
    engine_files: dict[str, str]  # file name -> XML of every engine and thruster that it names
    included: tuple[str, ...]  # files that were put into it, as they are named there
    left_out: tuple[str, ...]  # elements that were not taken, in words
    repaired: tuple[str, ...] = ()  # what was changed so that JSBSim takes it, in sentences


def find_model(path: Path) -> Path | None:
    """Return the main file of the JSBSim model that a path means, or None: an XML file, or a folder that holds one.

    In a folder it is the file with the folder's name, else the only one whose root is ``fdm_config``.

    Raises:
        ModelError: a folder holds several models and none has its name.
    """
    if path.is_file():
        return path if path.suffix.lower() == ".xml" else None
    if not path.is_dir():
        return None
    named = path / f"{path.resolve().name}.xml"
    if named.is_file():
        return named
    found = [p for p in sorted(path.glob("*.xml")) if holds_jsbsim_model(p)]
    if len(found) > 1:
        names = ", ".join(p.name for p in found)
        raise ModelError(f"a folder must hold one JSBSim model, or one of its own name, got {names}; name the file")
    return found[0] if found else None


def read_source(path: Path, repair: bool = False) -> Source:
    """Read a JSBSim model with everything that it includes.

    Args:
        path: its main file.
        repair: whether to mend what JSBSim refuses: systems whose file is missing are left out, and of functions that
            have one name all but the first get a number. Each is said.

    Raises:
        ModelError: a file is missing, is no XML (with line and column), or is no JSBSim model; functions of one name.
    """
    tree = _read(path)
    if tree.tag != "fdm_config":
        raise ModelError(f"a JSBSim model must begin with <fdm_config>, got <{tree.tag}> in '{path}'")
    home = path.resolve().parent
    repaired: list[str] = []
    read = {path: tree}
    included = tuple(_include(tree, home, path, read, repaired if repair else None))
    repaired += _renamed(tree, [path, *read], repair)
    left_out = []
    for tag in _LEFT_OUT:
        for element in tree.findall(tag):
            tree.remove(element)
            left_out.append(f"<{tag} name='{element.get('name', '')}'>")
    engines: dict[str, str] = {}
    for element in tree.iter():
        file = element.get("file")
        if element.tag in {"engine", "thruster"} and file is not None:
            found = _find(file, _engine_places(home))
            if found is None:
                raise ModelError(_missing(f"the {element.tag}", file, path, _engine_places(home)))
            name = found.name if found.suffix == ".xml" else f"{found.name}.xml"
            element.set("file", name.removesuffix(".xml"))
            _read(found)
            engines[name] = read_text(found, "JSBSim model", errors="replace")
    for element in tree.iter():
        if not isinstance(element.tag, str):  # pragma: no cover - the parser leaves comments out
            raise ModelError(f"a JSBSim model must consist of elements, got {element.tag!r} in '{path}'")
    tree.set("name", path.stem)
    text = ET.tostring(tree, encoding="unicode")
    return Source(path.stem, path, text, engines, included, tuple(left_out), tuple(repaired))


def _renamed(tree: ET.Element, files: Sequence[Path], repair: bool) -> list[str]:
    """Give functions that share a name with one before them a number; return what was done.

    Raises:
        ModelError: there are some, and nothing is to be repaired. JSBSim would refuse the model.
    """
    seen: set[str] = set()
    said = []
    for function in tree.iter("function"):
        name = (function.get("name") or "").strip()
        if name and name in seen:
            lines = [
                f"{file.name}, line {i}"
                for file in dict.fromkeys(files)
                for i, line in enumerate(read_text(file, "JSBSim model", errors="replace").splitlines(), 1)
                if "<function" in line and f'"{name}"' in line.replace("'", '"')
            ]
            where = f"'{name}' stands in {' and '.join(lines)}"
            if not repair:
                raise ModelError(
                    f"functions of a JSBSim model must have names of their own, but {where}; name one otherwise, or "
                    "adopt it with --repair, which gives the second a number: both count"
                )
            new = next(f"{name}-{k}" for k in range(2, 1000) if f"{name}-{k}" not in seen)
            function.set("name", new)
            said.append(f"repaired: {where}: one of them is '{new}' now, and both count")
            name = new
        seen.add(name)
    return said


def _include(
    tree: ET.Element, home: Path, main: Path, read: dict[Path, ET.Element], left_out: list[str] | None
) -> Iterator[str]:
    """Put the content of included files into ``tree``; yield their names, keep their paths in ``read``.

    A system whose file is missing is left out, if that may be said in ``left_out``.
    """
    for element in list(tree):
        file = element.get("file")
        if element.tag not in _INCLUDES or file is None:
            continue
        places = _engine_places(home) if element.tag == "propulsion" else _system_places(home)
        found = _find(file, (home, *places))
        if found is None:
            missing = _missing(f"the <{element.tag}>", file, main, (home, *places))
            if element.tag not in ("system", "autopilot"):
                raise ModelError(missing)
            if left_out is None:
                raise ModelError(f"{missing}, or adopt it with --repair, which leaves it out")
            left_out.append(f"repaired: <{element.tag} file='{file}'> is left out, as there is no such file")
            tree.remove(element)
            continue
        content = read[found] = _read(found)
        if content.tag != element.tag and {content.tag, element.tag} - {"system", "autopilot", "flight_control"}:
            raise ModelError(
                f"a file that <{element.tag}> of '{main}' includes must begin with <{element.tag}>, got "
                f"<{content.tag}> in '{found}'"
            )
        del element.attrib["file"]
        for key, value in content.attrib.items():
            element.attrib.setdefault(key, value)
        own = list(element)  # properties that the includer declares stand before what reads them
        for child in own:
            element.remove(child)
        element.extend([*own, *content])
        element.text = element.text or content.text
        yield found.name


def _read(path: Path) -> ET.Element:
    try:
        return read_xml(path, "JSBSim model")
    except RecordError as error:
        raise ModelError(error.message) from error


def _system_places(home: Path) -> tuple[Path, ...]:
    return (home / "Systems", home / "systems", home.parent.parent / "Systems", *_roots(home, "systems"))


def _engine_places(home: Path) -> tuple[Path, ...]:
    own = (home / "Engines", home / "engines", home / "Engine", home / "engine", home)
    return (*own, *_roots(home, "engine"))


def _roots(home: Path, folder: str) -> tuple[Path, ...]:
    """Return the folders of a JSBSim root directory: that of the model itself, then the one that comes with JSBSim."""
    stock = stock_root()
    return (home.parent.parent / folder, *((stock / folder,) if stock is not None else ()))


def _find(file: str, places: Sequence[Path]) -> Path | None:
    names = (file, f"{file}.xml")
    return next((p for place in places for n in names if (p := place / n.strip()).is_file()), None)


def _missing(what: str, file: str, main: Path, places: Sequence[Path]) -> str:
    looked = ", ".join(f"'{p}'" for p in places if p.is_dir())
    return f"{what} file '{file}' that '{main}' includes must exist, got none in {looked}; put it beside the model"
