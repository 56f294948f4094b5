"""The adapter around JSBSim: loads a model quietly, checks every property before it is read or written, and is reused.

JSBSim's manners that this file shields the rest from (measured with 1.3.3): it prints unless a logger is set in the
thread; the frame time must be set before the model is loaded; a load may fail by returning False; writing an unknown
property creates it and reading one gives zero; loading twice into one executive crashes; a reset puts the default
integrators back.
"""

from __future__ import annotations

import tempfile
from collections import OrderedDict
from pathlib import Path
from typing import Any

import jsbsim

from testbench.aircraft import Aircraft
from testbench.channels import CHANNELS, CONTROLS, channel, modal_channels
from testbench.constants import FT_M
from testbench.errors import ModelError
from testbench.flight.condition import FlightCondition

ADAMS_BASHFORTH_2 = 3  # JSBSim's number for it; its default, Euler for the rates, costs 3 % at 8 Hz
_INTEGRATORS = ("rate/rotational", "rate/translational", "position/rotational", "position/translational")
_CACHE: OrderedDict[int, Executive] = OrderedDict()
_CACHE_SIZE = 64


class _QuietLogger(jsbsim.FGLogger):  # type: ignore[misc]
    """Prints nothing and keeps what JSBSim reports at level error or above, for our own message."""

    def __init__(self) -> None:
        super().__init__()
        self.lines: list[str] = []
        self._level = jsbsim.LogLevel.BULK

    def set_level(self, level: Any) -> None:
        self._level = level

    def message(self, text: str) -> None:
        if self._level.value >= jsbsim.LogLevel.ERROR.value and text.strip():
            self.lines.append(text.strip())


class Executive:
    """One JSBSim executive with one loaded model; see :func:`executive`.

    Args:
        aircraft: what is flown.
        rate_hz: frame rate; elastic equations are generated for it.
        condition: design condition of the elastic equations.

    Raises:
        ModelError: JSBSim refuses the model; the message carries JSBSim's own words.
    """

    def __init__(self, aircraft: Aircraft, rate_hz: float, condition: FlightCondition) -> None:
        self.aircraft = aircraft
        self.rate_hz = rate_hz
        xml = aircraft.model_xml(rate_hz, condition.qbar_Pa, condition.V_m_s)
        modes = aircraft.flown_modes()
        self.mode_count = len(modes) if modes else 0
        self._iterations = 5 if "alphadot" in xml else 2  # see evaluate()
        self._logger = _QuietLogger()
        jsbsim.set_logger(self._logger)
        with tempfile.TemporaryDirectory() as root:
            place = Path(root) / "aircraft" / "model"
            (place / "Engines").mkdir(parents=True)
            (place / "model.xml").write_text(xml, encoding="utf-8")
            for name, text in aircraft.engine_files.items():
                (place / "Engines" / name).write_text(text, encoding="utf-8")
            self.fdm = jsbsim.FGFDMExec(root)
            self.fdm.set_debug_level(0)
            self.fdm.set_dt(1.0 / rate_hz)
            try:
                loaded = self.fdm.load_model("model")
                if loaded:
                    self.fdm.run_ic()  # an undefined property in a function shows here, not before
            except RuntimeError as error:
                raise ModelError(f"JSBSim refuses the model of {aircraft.name}: {error}") from error
            if not loaded:
                said = "; ".join(self._logger.lines[-3:]) or "no reason given"
                raise ModelError(f"JSBSim refuses the model of {aircraft.name}: {said}")
        self._manager = self.fdm.get_property_manager()
        self._nodes: dict[str, Any] = {}
        self.channels = self._available_channels()
        self.factors = [self._factor(name) for name in self.channels]
        self.channel_nodes = [self.node(str(channel(name).jsbsim_property)) for name in self.channels]
        self.command_nodes = {n: self.node(aircraft.controls[n].command) for n in CONTROLS if n in aircraft.controls}

    def _available_channels(self) -> tuple[str, ...]:
        names = [n for n, c in CHANNELS.items() if self._has(c.jsbsim_property)]
        return (*names, *modal_channels(self.mode_count))

    def _factor(self, name: str) -> float:
        c = channel(name)
        return c.factor / self.aircraft.mass.mass_kg if c.per_mass else c.factor

    def _has(self, name: str | None) -> bool:
        return name is not None and self._manager.hasNode(name)

    def node(self, name: str) -> Any:
        """Return the property node ``name``.

        Raises:
            ModelError: the model has no such property (JSBSim itself would create it in silence).
        """
        if name not in self._nodes:
            if not self._manager.hasNode(name):
                raise ModelError(f"a property must exist before it is used, got '{name}' in {self.aircraft.name}")
            self._nodes[name] = self._manager.get_node(name)
        return self._nodes[name]

    def get(self, name: str) -> float:
        """Return the value of a JSBSim property, in JSBSim's unit."""
        return float(self.node(name).get_double_value())

    def set(self, name: str, value: float) -> None:
        """Write a JSBSim property, in JSBSim's unit."""
        self.node(name).set_double_value(value)

    def reset(self) -> None:
        """Go back to time zero, zero controls and declared values, with the integrators of this testbench."""
        jsbsim.set_logger(self._logger)  # the logger belongs to the thread, and another executive may have set its own
        self.fdm.reset_to_initial_conditions(0)
        for name in _INTEGRATORS:
            self.set(f"simulation/integrator/{name}", ADAMS_BASHFORTH_2)

    def start_engines(self) -> None:
        """Set all engines running; a reset stops them."""
        self.fdm.get_propulsion().init_running(-1)

    def command(self, values: dict[str, float]) -> None:
        """Set control commands, SI."""
        for name, value in values.items():
            self.command_nodes[name].set_double_value(value / self.aircraft.controls[name].full)

    def place(self, h_m: float, theta: float, phi: float, uvw_m_s: Any, pqr: Any = (0.0, 0.0, 0.0)) -> None:
        """Set the initial conditions (attitude before velocity: JSBSim keeps body velocities only in that order)."""
        self.set("ic/h-sl-ft", h_m / FT_M)
        self.set("ic/psi-true-rad", 0.0)
        self.set("ic/theta-rad", theta)
        self.set("ic/phi-rad", phi)
        for axis, value in zip("uvw", uvw_m_s, strict=True):
            self.set(f"ic/{axis}-fps", value / FT_M)
        for axis, value in zip("pqr", pqr, strict=True):
            self.set(f"ic/{axis}-rad_sec", value)

    def evaluate(self) -> None:
        """Evaluate all forces at the initial conditions, time standing still.

        Repeated because the control system runs before the airspeed of the new state is known (thrust falls with
        airspeed), and because a lift that depends on alphadot closes a loop over wdot whose gain is some 2 %.
        """
        for _ in range(self._iterations):
            self.fdm.run_ic()

    def read(self) -> dict[str, float]:
        """Return every channel of the current state, SI."""
        values = (node.get_double_value() * f for node, f in zip(self.channel_nodes, self.factors, strict=True))
        return dict(zip(self.channels, values, strict=True))


def executive(aircraft: Aircraft, rate_hz: float, condition: FlightCondition) -> Executive:
    """Return an executive for this model, from the process's cache if it has been loaded before.

    A reused executive flies bit-for-bit like a fresh one (tests/flight/test_simulate.py).
    """
    modes = aircraft.flown_modes()
    design = (condition.qbar_Pa, condition.V_m_s) if modes else None  # a rigid model is the same at every speed
    engines = tuple(sorted(aircraft.engine_files.items()))
    key = hash((aircraft.xml, repr(modes), repr(aircraft.amendments), engines, rate_hz, design))
    if key not in _CACHE:
        _CACHE[key] = Executive(aircraft, rate_hz, condition)
        if len(_CACHE) > _CACHE_SIZE:
            _CACHE.popitem(last=False)
    _CACHE.move_to_end(key)
    return _CACHE[key]
