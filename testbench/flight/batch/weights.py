"""Mass, centre of gravity and inertia of a model that differs from another in these numbers only (FGMassBalance)."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass

import numpy as np

from testbench.core.record import FloatArray
from testbench.flight.batch.program import Untranslated
from testbench.flight.batch.units import convert, triplet

_LB_SLUG = 1.0 / 32.174049
_IN_FT = 1.0 / 12.0
_TURN = np.array([-1.0, 1.0, -1.0])  # from structural axes (aft, right, up) to the body's


@dataclass(frozen=True, eq=False)
class Weights:
    """What a body weighs and how it is spread.

    Attributes:
        weight: lbf.
        cg: (3,) in, structural axes.
        inertia: (3, 3) about the centre of gravity, body axes, slug ft2, as JSBSim's matrix has it.
    """

    weight: float
    cg: FloatArray
    inertia: FloatArray

    def about_origin(self) -> FloatArray:
        """Return the inertia (3, 3) about the origin of the structural axes, body axes."""
        return self.inertia + _parallel(self.weight, self.cg)

    def with_empty(self, before: Weights, after: Weights) -> Weights:
        """Return this body after its dry part, ``before``, has been replaced by ``after``; fuel stays as it is."""
        weight = self.weight - before.weight + after.weight
        moment = self.weight * self.cg - before.weight * before.cg + after.weight * after.cg
        origin = self.about_origin() - before.about_origin() + after.about_origin()
        cg = moment / weight
        return Weights(weight, cg, origin - _parallel(weight, cg))


def _parallel(weight: float, at_in: FloatArray) -> FloatArray:
    """Return the inertia (3, 3) of a point about the origin, body axes."""
    x = _TURN * at_in * _IN_FT
    return _LB_SLUG * weight * (x @ x * np.eye(3) - np.outer(x, x))


def dry(tree: ET.Element) -> Weights:
    """Return the empty aircraft with its point masses.

    Raises:
        Untranslated: a point mass has a shape of its own, or a unit is not known.
    """
    balance = tree.find("mass_balance")
    if balance is None:
        raise Untranslated("it has no mass balance")
    sign = 1.0 if balance.get("negated_crossproduct_inertia") == "false" else -1.0
    given = {n: convert(balance.find(n), "SLUG*FT2", 0.0) for n in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")}
    J = np.array(
        [
            [given["ixx"], sign * given["ixy"], -sign * given["ixz"]],
            [sign * given["ixy"], given["iyy"], sign * given["iyz"]],
            [-sign * given["ixz"], sign * given["iyz"], given["izz"]],
        ]
    )
    empty = convert(balance.find("emptywt"), "LBS", 0.0)
    at = next((triplet(e, "IN") for e in balance.findall("location") if e.get("name") == "CG"), [0.0, 0.0, 0.0])
    points = [(empty, np.array(at))]
    for e in balance.findall("pointmass"):
        if e.find("form") is not None:
            raise Untranslated("a point mass has a shape")
        points.append((convert(e.find("weight"), "LBS", 0.0), np.array(triplet(e.find("location"), "IN"))))
    weight = sum(w for w, _ in points)
    if not weight > 0.0:
        raise Untranslated("it weighs nothing without fuel")
    cg = np.sum([w * x for w, x in points], axis=0) / weight
    origin = J + np.sum([_parallel(w, x) for w, x in points], axis=0)
    return Weights(float(weight), cg, origin - _parallel(weight, cg))
