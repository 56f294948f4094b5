"""Turbines as operations (FGTurbine): two spools that seek what the throttle wants, and thrust by tables.

While time stands still JSBSim gives the thrust of the throttle at once, and the first frame afterwards puts the spools
where the throttle wants them. An engine that does not run has no fuel: its spools windmill and it gives nothing.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping

from testbench.flight.batch import registers as r
from testbench.flight.batch.air import SEA_LEVEL_RHO
from testbench.flight.batch.mount import Mount
from testbench.flight.batch.program import Untranslated
from testbench.flight.batch.terms import Term
from testbench.flight.batch.units import convert

_MOST_LBS = 10000.0
_LAST_PERCENT, _NEAR_FULL_N2 = 0.99, 97.0  # from which throttle and N2 the burner of method 1 lights
_BY_LAST_PERCENT, _BY_FCS = 1, 2


class Turbine:
    """One turbine.

    Args:
        mount: where it runs.
        e: the ``turbine_engine`` element.

    Raises:
        Untranslated: it has no tables of thrust, or water is injected into it.
    """

    def __init__(self, mount: Mount, e: ET.Element) -> None:
        self._m, self._e = mount, e
        if int(self._number("injected", 0.0)) == 1:
            mount.unmoved("propulsion/engine[#]/injection_cmd")
        mount.unmoved(
            "propulsion/cutoff_cmd", "propulsion/starter_cmd", "propulsion/engine[#]/set-running",
            "propulsion/engine[#]/stalled", "propulsion/engine[#]/seized",
        )  # fmt: skip
        self._idle_1, self._idle_2 = mount.term(self._number("idlen1", 30.0)), mount.term(self._number("idlen2", 60.0))
        self._most_1 = mount.given("MaxN1", self._number("maxn1", 100.0))
        self._most_2 = mount.given("MaxN2", self._number("maxn2", 100.0))

    def _number(self, name: str, default: float) -> float:
        text = self._e.findtext(name)
        return default if text is None else float(text)

    def thrust(self) -> Term:
        """Return the thrust of a frame, lbf."""
        m = self._m
        functions = m.functions(self._e)
        if not {"IdleThrust", "MilThrust"} <= set(functions):
            raise Untranslated("a turbine has no tables of idle and military thrust")
        lever = m.lever("throttle")
        augmenting = (lever > 1.0).then(lever - 1.0, 0.0)
        throttle = (lever > 1.0).then(lever - augmenting, lever)
        still, was_still = m.dt.equals(0.0), m.hidden("still")
        running = m.get("set-running")
        span_1, span_2 = self._most_1 - self._idle_1, self._most_2 - self._idle_2
        want_1, want_2 = self._idle_1 + throttle * span_1, self._idle_2 + throttle * span_2
        turning = self._spools(functions, want_1, want_2, was_still)
        n1, n2 = (
            still.then(m.get(n), (running > 0.5).then(fast, slow))
            for n, fast, slow in zip(("n1", "n2"), turning, self._windmill(), strict=True)
        )
        speed = still.then(want_2, n2)
        norm = (speed - self._idle_2) / span_2
        m.hide("n2-norm", still.then(m.hidden("n2-norm"), norm))
        most = m.term(convert(self._e.find("milthrust"), "LBS", _MOST_LBS))
        idle = most * functions["IdleThrust"]
        rest = (most - idle) * functions["MilThrust"]
        dry = idle + rest * norm * norm
        force = self._augmented(functions, dry, throttle, augmenting, speed, still)
        force = (running > 0.5).then(force, 0.0)
        m.hide("still", still)
        m.set("n1", n1)
        m.set("n2", n2)
        m.set("set-running", running)
        return force

    def _spools(self, functions: Mapping[str, Term], want_1: Term, want_2: Term, was_still: Term) -> tuple[Term, Term]:
        """Return N1 and N2 of a running engine, %, after a frame."""
        m = self._m
        n = (m.hidden("n2-norm") + 0.1).at_most(1.0)
        left = 1.0 - n
        thin = 1.0 - m.core(r.DENSITY) / SEA_LEVEL_RHO
        slow = 1.0 + 3.0 * left * left * left + thin
        bypass = self._number("bypassratio", 0.0)

        def rate(name: str, factor: float) -> Term:
            """Return by how much a spool may change, %/s."""
            return functions[name] if name in functions else m.term(factor * 90.0 / (bypass + 3.0)) / slow

        n1 = was_still.then(want_1, m.get("n1")).seek(want_1, rate("N1SpoolUp", 1.0), rate("N1SpoolDown", 2.4), m.dt)
        n2 = was_still.then(want_2, m.get("n2")).seek(want_2, rate("N2SpoolUp", 1.0), rate("N2SpoolDown", 3.0), m.dt)
        return n1, n2

    def _windmill(self) -> tuple[Term, Term]:
        """Return N1 and N2 of an engine that does not run, %, after a frame."""
        m, out = self._m, []
        if (self._e.findtext("disable-windmill") or "0").strip() not in {"0", "false"}:
            raise Untranslated("a turbine does not windmill")
        for name, over in (("n1", 10.0), ("n2", 15.0)):
            n = m.get(name)
            down = n / m.term(self._number(f"{name}spindown", 2.0))
            out.append(n.seek(m.core(r.QBAR) / over, n / 2.0 + 0.1, down, m.dt))
        return out[0], out[1]

    def _augmented(
        self, functions: Mapping[str, Term], dry: Term, throttle: Term, augmenting: Term, n2: Term, still: Term
    ) -> Term:
        """Return the thrust with bleed air taken off and the afterburner lit, lbf."""
        m = self._m
        method, fitted = int(self._number("augmethod", 0.0)), int(self._number("augmented", 0.0)) == 1
        bled = dry * (1.0 - m.given("bleed-factor", self._number("bleed", 0.0)))
        if "AugThrust" not in functions:
            if fitted or method == _BY_FCS:
                raise Untranslated("an afterburner has no table of thrust")
            return bled
        most = m.term(convert(self._e.find("maxthrust"), "LBS", _MOST_LBS)) * functions["AugThrust"]
        lit = m.hidden("augmented")
        force = still.then(bled, (lit > 0.5).then(dry, bled))
        if method == _BY_LAST_PERCENT:
            lit = (throttle > _LAST_PERCENT) & (n2 > _NEAR_FULL_N2)
            m.hide("augmented", lit)
            return (lit > 0.5).then(most, force) if fitted else force
        if method == _BY_FCS:
            burns = augmenting > 0.0
            m.hide("augmented", still.then(lit, burns))
            return burns.then(force + (most - force) * augmenting.at_most(1.0), force)
        return force
