"""Amendments: named changes to an aircraft that are carried as data and applied when its JSBSim model is written.

A change is told which aircraft it is applied to, and reaches a model of any form: coefficients and thrust by reactions
(:mod:`testbench.aircraft.reactions`), mass and inertia by what is added to those as flown. What asks an aircraft where
its commands, surfaces and masses are stands in :mod:`testbench.aircraft.seams`.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from testbench.aircraft.elastic import ElasticMode, ElasticModel
from testbench.aircraft.paths import path_of, read_by_aerodynamics
from testbench.aircraft.reactions import COEFFICIENTS, MOTIONS, THRUST, WHOLE, element, number, quantity, react, whole
from testbench.core.constants import FT_M, SLUG_KG
from testbench.core.errors import ModelError

if TYPE_CHECKING:
    from testbench.aircraft.model import Aircraft

_SLUG_FT2 = SLUG_KG * FT_M**2
_UNITS_KG_M2 = {"KG*M2": 1.0, "SLUG*FT2": _SLUG_FT2}


@dataclass(frozen=True)
class SetProperty:
    """Give a declared property of the model another value."""

    name: str
    value: float

    def apply(self, tree: ET.Element, aircraft: Aircraft) -> None:
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

    def apply(self, tree: ET.Element, aircraft: Aircraft) -> None:
        """Change ``tree`` in place; ModelError if no such element exists."""
        found = tree.find(self.path)
        if found is None:
            raise ModelError(f"an amended element must exist in the model, got '{self.path}'")
        found.text = repr(float(self.value))


@dataclass(frozen=True)
class Insert:
    """Insert an element, given as XML text, at the end (or at ``position``) of the element at ``parent``."""

    parent: str
    xml: str
    position: int | None = None

    def apply(self, tree: ET.Element, aircraft: Aircraft) -> None:
        """Change ``tree`` in place; ModelError if the parent does not exist."""
        parent = tree if self.parent == "." else tree.find(self.parent)
        if parent is None:
            raise ModelError(f"an amendment must go into an element of the model, got '{self.parent}'")
        parent.insert(len(parent) if self.position is None else self.position, ET.fromstring(self.xml))


@dataclass(frozen=True)
class Increment:
    """Add the product of ``terms`` to an aerodynamic coefficient: CL, CD (drag positive), CY, Cl, Cm or Cn."""

    coefficient: str  # which
    name: str  # of the term: the function of a model in the testbench's own form
    terms: tuple[str, ...]  # XML of each factor

    def apply(self, tree: ET.Element, aircraft: Aircraft) -> None:
        """Change ``tree`` in place; ModelError if a model in the testbench's own form lacks the axis."""
        terms = [ET.fromstring(t) for t in self.terms]
        if aircraft.adapter is not None:
            react(tree, self.coefficient, terms, _centre(aircraft))
            return
        axis, length = COEFFICIENTS[self.coefficient]
        parent = tree.find(f"aerodynamics/axis[@name='{axis}']")
        if parent is None:
            raise ModelError(f"an increment of {self.coefficient} needs <axis name='{axis}'>, {aircraft.name} has none")
        lengths = [] if length is None else [length]
        product = element("product", "aero/qbar-psf", "metrics/Sw-sqft", *lengths, *terms)
        parent.append(element("function", product, name=self.name))


@dataclass(frozen=True)
class ScaleCoefficient:
    """Multiply an aerodynamic coefficient by a factor.

    In a model in the testbench's own form it is the function ``aero/coefficient/NAME``. Of any other it is what
    perturbing it at its design condition gives (:mod:`testbench.flight.coefficients`): (factor - 1) C x is added, with
    x the angle, nondimensional rate or deflection itself and not its deviation from trim. "CD" and the other five
    without a variable are the whole coefficient in flight, "CL0" its part that follows nothing.
    """

    name: str
    factor: float

    def apply(self, tree: ET.Element, aircraft: Aircraft) -> None:
        """Change ``tree`` in place; ModelError if the model has no such coefficient."""
        if aircraft.adapter is not None:
            react(tree, self.name[:2], self._terms(aircraft), _centre(aircraft))
            return
        for function in tree.iter("function"):
            product = function.find("product")
            if function.get("name") == f"aero/coefficient/{self.name}" and product is not None:
                product.append(number(self.factor))
                return
        raise ModelError(f"an amended coefficient must exist in the model, got '{self.name}'")

    def _terms(self, aircraft: Aircraft) -> list[ET.Element]:
        """Return the factors of what is added to a model of another form."""
        more = number(self.factor - 1.0)
        if self.name in WHOLE:
            return [more, whole(self.name)]
        value = number(aircraft.coefficient(self.name))
        variable = "zero" if self.name.endswith("0") else self.name.partition("_")[2]
        if variable in {"de", "da", "dr"}:
            surface = aircraft.source_of(variable)[0]
            if surface is None:
                raise ModelError(f"{self.name} needs the control {variable}, {aircraft.name} has none")
            return [more, value, quantity(surface)]
        return [more, value, *(quantity(n) for n in MOTIONS[variable])]


@dataclass(frozen=True)
class ReplaceCoefficient:
    """Put a function in the place of a whole coefficient, by so much as a share says: share (function - coefficient).

    What is replaced is all that the aerodynamics of the model make in that frame; what reactions add to it stays. At a
    model of any form.
    """

    coefficient: str  # CL, CD, CY, Cl, Cm or Cn
    # function, share: JSBSim properties; share from 0 to 1
    function: str
    share: str
    at_in: tuple[float, float, float]  # centre of gravity that forces act at, inches in the structural frame

    def apply(self, tree: ET.Element, aircraft: Aircraft) -> None:
        """Change ``tree`` in place."""
        change = element("difference", self.function, whole(self.coefficient))
        react(tree, self.coefficient, [quantity(self.share), change], self.at_in)


@dataclass(frozen=True)
class AddCoefficient:
    """Add ``value`` (x - ``about``) to the coefficient of a derivative: CL_alpha, Cm_q, Cn_dr ...

    x is the angle or deflection, rad, or the nondimensional rate p b/2V, q cbar/2V, r b/2V. Where x is ``about`` the
    coefficient stays what it was, and so does an equilibrium there.

    In a model in the testbench's own form the numbers of ``aero/coefficient/NAME`` and of the constant change; where it
    has no one number, a function ``aero/increment/NAME`` is added. Any other model gets a reaction.
    """

    name: str
    value: float
    about: float = 0.0

    def apply(self, tree: ET.Element, aircraft: Aircraft) -> None:
        """Change ``tree`` in place; ModelError if the aircraft lacks the control, or its model the axis."""
        coefficient, _, variable = self.name.partition("_")
        constant = -self.value * self.about
        if aircraft.adapter is not None:
            react(tree, coefficient, [number(self.value), *_variable(self.name, tree, aircraft)], _centre(aircraft))
            if constant:
                react(tree, coefficient, [number(constant)], _centre(aircraft))
            return
        _add_number(tree, coefficient, variable, self.value, _variable(self.name, tree, aircraft), aircraft)
        if constant:
            _add_number(tree, coefficient, "0", constant, [], aircraft)


def _variable(name: str, tree: ET.Element, aircraft: Aircraft) -> list[ET.Element]:
    """Return the factors whose product is the variable of a derivative.

    Raises:
        ModelError: the aircraft has no such control.
    """
    variable = name.partition("_")[2]
    if variable not in {"de", "da", "dr"}:
        return [quantity(n) for n in MOTIONS[variable]]
    path = path_of(aircraft.adapter, variable) if variable in aircraft.controls else None
    if path is None:
        raise ModelError(f"{name} needs the control {variable}, {aircraft.name} has none")
    return [quantity(path.servo if aircraft.adapter is not None else read_by_aerodynamics(tree, path))]


def _add_number(
    tree: ET.Element, coefficient: str, variable: str, value: float, terms: list[ET.Element], aircraft: Aircraft
) -> None:
    """Add to the one number of a function in the testbench's own form, or add a function that has one."""
    name = f"{coefficient}0" if variable == "0" else f"{coefficient}_{variable}"
    label = f"aero/increment/{name}"
    for function in tree.iter("function"):
        if function.get("name") in (f"aero/coefficient/{name}", label):
            numbers = function.findall("product/value")
            if len(numbers) == 1:
                numbers[0].text = repr(float(numbers[0].text or "nan") + value)
                return
    factors = tuple(ET.tostring(t, encoding="unicode") for t in (*terms, number(value)))
    Increment(coefficient, label, factors).apply(tree, aircraft)


@dataclass(frozen=True)
class Thrust:
    """Add a share of all forces and moments of the engines, at a model of any form."""

    share: str  # XML; -0.2 takes a fifth away

    def apply(self, tree: ET.Element, aircraft: Aircraft) -> None:
        """Change ``tree`` in place."""
        for name in THRUST:
            react(tree, name, [ET.fromstring(self.share)], _centre(aircraft))


@dataclass(frozen=True)
class ThrustLine:
    """Raise the line of the thrust by ``up_m``: the thrust gets a pitching moment about the centre of gravity."""

    up_m: float

    def apply(self, tree: ET.Element, aircraft: Aircraft) -> None:
        """Change ``tree`` in place."""
        react(tree, "thrust-line", [number(-self.up_m / FT_M)], _centre(aircraft))


@dataclass(frozen=True)
class AddInertia:
    """Add to a moment or product of inertia (Ixx ... Ixy), kg m2; signs of products as JSBSim gives and takes them."""

    axis: str
    kg_m2: float

    def apply(self, tree: ET.Element, aircraft: Aircraft) -> None:
        """Change ``tree`` in place; ModelError if the model has no mass or a unit that is not known."""
        balance = tree.find("mass_balance")
        if balance is None:
            raise ModelError(f"{aircraft.name} must hold <mass_balance>, it does not")
        inertia = balance.find(self.axis.lower())
        if inertia is None:
            inertia = element(self.axis.lower(), text="0.0", unit="KG*M2")
            balance.insert(0, inertia)
        unit = (inertia.get("unit") or "SLUG*FT2").upper()
        if unit not in _UNITS_KG_M2:
            raise ModelError(f"{self.axis} of {aircraft.name} must be in KG*M2 or SLUG*FT2, got {unit}")
        inertia.text = repr(float(inertia.text or "nan") + self.kg_m2 / _UNITS_KG_M2[unit])


Change = (
    SetProperty
    | SetText
    | Insert
    | Increment
    | ScaleCoefficient
    | ReplaceCoefficient
    | AddCoefficient
    | Thrust
    | ThrustLine
    | AddInertia
)


def _centre(aircraft: Aircraft) -> tuple[float, float, float]:
    """Return where the centre of gravity was when the model was loaded, in.

    Raises:
        ModelError: nobody has looked.
    """
    if aircraft.adapter is None or aircraft.adapter.cg_in is None:
        raise ModelError(f"{aircraft.name} must be loaded with load_aircraft before it is changed")
    return aircraft.adapter.cg_in


@dataclass(frozen=True)
class Memory:
    """A property that follows another with a first-order lag, a state that is not among JSBSim's own.

    It does not move while time stands still, so a linearisation must be told how it will move.
    """

    name: str  # of the state
    follows: str  # property that holds what is followed while time stands still
    start: str  # property that sets the state while time stands still; 0 before
    rate_rad_s: float  # one over the time constant
    settles: bool = False  # True if it is then at what it follows, plus ``start``; False if it is ``start`` alone
    commanded: bool = False  # True if a command is what it follows, which moves before the servo does


@dataclass(frozen=True)
class Amendment:
    """A change with a name: edits of the XML and, possibly, further elastic modes.

    ``memories`` are the states that the edits bring with them. ``upstream`` is how far up the path from the pilot's
    command to the forces it acts: edits are made from the forces up to the command, in whatever order amendments came.
    ``rate_hz`` is the frame rate that the edits count frames of; None if they are the same at any.
    """

    name: str
    description: str
    changes: tuple[Change, ...] = ()
    modes: tuple[ElasticMode, ...] = ()
    memories: tuple[Memory, ...] = ()
    upstream: int = 0
    rate_hz: float | None = None

    def apply(self, tree: ET.Element, aircraft: Aircraft) -> None:
        """Apply the edits of the XML to ``tree`` in place."""
        for change in self.changes:
            change.apply(tree, aircraft)

    def modes_added(self, elastic: ElasticModel | None, S_m2: float, cbar_m: float) -> ElasticModel | None:
        """Return the elastic model with the modes of this amendment after its own."""
        if not self.modes:
            return elastic
        if elastic is None:
            return ElasticModel(self.modes, S_m2, cbar_m)
        return replace(elastic, modes=(*elastic.modes, *self.modes))
