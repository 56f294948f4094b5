"""Amendments: named changes to an aircraft that are carried as data and applied when its JSBSim model is written."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass, replace

from testbench.aircraft.elastic import ElasticMode, ElasticModel
from testbench.core.errors import ModelError


@dataclass(frozen=True)
class SetProperty:
    """Give a declared property of the model another value."""

    name: str
    value: float

    def apply(self, tree: ET.Element) -> None:
        """Change ``tree`` in place; ModelError if no such property is declared."""
        found = [e for e in tree.iter("property") if (e.text or "").strip() == self.name and "value" in e.attrib]
        if not found:
            raise ModelError(f"an amended property must be declared in the model, got '{self.name}'")
        found[0].set("value", repr(float(self.value)))


@dataclass(frozen=True)
class SetText:
    """Give the element at ``path`` (ElementTree path below fdm_config) another number."""

    path: str
    value: float

    def apply(self, tree: ET.Element) -> None:
        """Change ``tree`` in place; ModelError if no such element exists."""
        element = tree.find(self.path)
        if element is None:
            raise ModelError(f"an amended element must exist in the model, got '{self.path}'")
        element.text = repr(float(self.value))


@dataclass(frozen=True)
class Insert:
    """Insert an element, given as XML text, at the end (or at ``position``) of the element at ``parent``."""

    parent: str
    xml: str
    position: int | None = None

    def apply(self, tree: ET.Element) -> None:
        """Change ``tree`` in place; ModelError if the parent does not exist."""
        parent = tree if self.parent == "." else tree.find(self.parent)
        if parent is None:
            raise ModelError(f"an amendment must go into an element of the model, got '{self.parent}'")
        element = ET.fromstring(self.xml)
        parent.insert(len(parent) if self.position is None else self.position, element)


@dataclass(frozen=True)
class ScaleCoefficient:
    """Multiply the aerodynamic coefficient ``aero/coefficient/NAME`` by a factor."""

    name: str
    factor: float

    def apply(self, tree: ET.Element) -> None:
        """Change ``tree`` in place; ModelError if the model has no such coefficient."""
        for function in tree.iter("function"):
            product = function.find("product")
            if function.get("name") == f"aero/coefficient/{self.name}" and product is not None:
                ET.SubElement(product, "value").text = repr(float(self.factor))
                return
        raise ModelError(f"an amended coefficient must exist in the model, got '{self.name}'")


Change = SetProperty | SetText | Insert | ScaleCoefficient


@dataclass(frozen=True)
class Memory:
    """A property that follows another with a first-order lag, a state that is not among JSBSim's own.

    It does not move while time stands still, so a linearisation must be told how it will move.

    Attributes:
        name: of the state.
        follows: property that holds what is followed while time stands still.
        start: property that sets the state while time stands still; 0 before.
        rate_rad_s: one over the time constant.
        settles: True if it is then at what it follows, plus ``start``; False if it is ``start`` alone.
    """

    name: str
    follows: str
    start: str
    rate_rad_s: float
    settles: bool = False


@dataclass(frozen=True)
class Amendment:
    """A change with a name: edits of the XML and, possibly, further elastic modes.

    ``memories`` are the states that the edits bring with them. ``upstream`` is how far up the path from the pilot's
    command to the forces it acts: edits are made from the forces up to the command, in whatever order amendments came.
    """

    name: str
    description: str
    changes: tuple[Change, ...] = ()
    modes: tuple[ElasticMode, ...] = ()
    memories: tuple[Memory, ...] = ()
    upstream: int = 0

    def apply(self, tree: ET.Element) -> None:
        """Apply the edits of the XML to ``tree`` in place."""
        for change in self.changes:
            change.apply(tree)

    def modes_added(self, elastic: ElasticModel | None, S_m2: float, cbar_m: float) -> ElasticModel | None:
        """Return the elastic model with the modes of this amendment after its own."""
        if not self.modes:
            return elastic
        if elastic is None:
            return ElasticModel(self.modes, S_m2, cbar_m)
        return replace(elastic, modes=(*elastic.modes, *self.modes))
