"""The adapter around JSBSim: loads a model quietly and checks every property before it is read or written.

Habits of JSBSim from which this file shields the rest (measured with 1.3.3): it prints unless a logger is set in the
thread; the frame time must be set before the model is loaded; a load may fail by returning False; writing an unknown
property creates it and reading one gives zero; loading twice into one executive crashes.
"""

from __future__ import annotations

import ctypes
import itertools
import os
import re
import weakref
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

import jsbsim
import numpy as np

from testbench.aircraft import Aircraft
from testbench.core.channels import CHANNELS, CONTROLS, modal_channels
from testbench.core.constants import FT_M, LBF_N
from testbench.core.errors import ModelError
from testbench.core.files import Scratch, temporary, write_file
from testbench.core.interrupts import held_back
from testbench.core.keyed import Keyed
from testbench.core.record import FloatArray
from testbench.flight.condition import FlightCondition
from testbench.flight.propellers import Propellers

_SEA_LEVEL_PSF = 2116.228
HP_W = 745.7
_FREEZE = "propulsion/fuel_freeze"
_GUSTS = tuple(f"atmosphere/gust-{axis}-fps" for axis in ("north", "east", "down"))


class _QuietLogger(jsbsim.FGLogger):
    """Prints nothing and keeps what JSBSim reports at level error or above, for our own message."""

    def __init__(self) -> None:
        super().__init__()
        self.lines: list[str] = []
        self._level = jsbsim.LogLevel.BULK

    def set_level(self, level: Any) -> None:
        """Take the level of the message that follows."""
        self._level = level

    def message(self, text: str) -> None:
        """Keep a message at level error or above."""
        if self._level.value >= jsbsim.LogLevel.ERROR.value and text.strip():
            self.lines.append(text.strip())


class UndefinedProperties(ModelError):
    """A model reads properties that nothing defines; ``missing`` holds their names."""

    def __init__(self, message: str, missing: Sequence[str]) -> None:
        super().__init__(message)
        self.missing = tuple(missing)


# JSBSim's number for Adams-Bashforth of third order. Its default, Euler for the rates, costs 3 % at 8 Hz; second order
# costs 0.6 % of a modal rate at 21 to 30 Hz and 500 frames per second; fourth order is stable over half the range only.
ADAMS_BASHFORTH_3 = 4
_NONE = 0
_LAW_RESTS_S = 3.0  # of frames in which a model's own control law comes to rest
_INTEGRATORS = ("rate/rotational", "rate/translational", "position/rotational", "position/translational")
ACCELERATIONS = (
    *((f"accelerations/{a}dot-ft_sec2", FT_M) for a in "uvw"),
    *((f"accelerations/{a}dot-rad_sec2", 1.0) for a in "pqr"),
)
"""Property and factor to SI of the six accelerations of the rigid body, m/s2 and rad/s2."""
_NAME = r"(/?[\w-]+(?:/[\w\[\]-]+)+)"
_OF_FILE = re.compile(r"In file \S+: line \d+")
_NAMED_MISSING = re.compile(rf"{_NAME}[\s\"']+does not exist")


class Executive:
    """One JSBSim executive with one freshly loaded model, ready at time zero with the engines running.

    One executive serves one trim, one flight or one linearisation. It cannot be used again: its initial conditions keep
    some bits of what they were (they are recomputed from one another), so that results would depend on what the process
    flew before. A fresh one costs a few milliseconds.

    Args:
        aircraft: what is flown.
        rate_hz: frame rate; elastic equations are generated for it.
        condition: design condition of the elastic equations.

    Raises:
        ModelError: JSBSim refuses the model; the message carries JSBSim's own words.
    """

    @held_back()  # JSBSim tells our logger what it does while it loads a model
    def __init__(self, aircraft: Aircraft, rate_hz: float, condition: FlightCondition) -> None:
        self.aircraft = aircraft
        self.rate_hz = rate_hz
        written = _write(model_key(aircraft, rate_hz, condition))
        modes = aircraft.flown_modes()
        self.mode_count = len(modes) if modes else 0
        # See evaluate(). The gains of the loops that it closes are 2e-2 (alphadot) and some 1e-5 (static elasticity).
        self._read = written.properties
        self._iterations, self.to_rest = (5, 12) if "aero/alphadot-rad_sec" in written.properties else (2, 5)
        if aircraft.adapter is not None:
            self._iterations = max(3, self._iterations)  # throttle: command, position, thrust
            if aircraft.under_law:
                self.to_rest = round(_LAW_RESTS_S * rate_hz)
        self._logger = _QuietLogger()
        jsbsim.set_logger(self._logger)
        self.fdm = jsbsim.FGFDMExec(written.root)
        self._manager = self.fdm.get_property_manager()
        self._nodes: dict[str, Any] = {}
        self.fdm.set_debug_level(0)
        self.fdm.set_dt(1.0 / rate_hz)
        try:
            loaded = self.fdm.load_model(written.name, False)
            self._refuse_unknown_properties(written.properties)
            if loaded:
                self.fdm.run_ic()
        except RuntimeError as error:
            raise self._refusal(str(error)) from error
        if not loaded:
            said = "; ".join(self._logger.lines[-3:]) or "no reason given"
            raise self._refusal(said)
        self._integrators = [self.node(f"simulation/integrator/{name}") for name in _INTEGRATORS]
        for node in self._integrators:
            node.set_double_value(ADAMS_BASHFORTH_3)
        self._wind = np.zeros(3)
        if aircraft.adapter is not None:
            # In the air before the gear is raised: a raised wheel feels for ever what it felt last, on the ground.
            self.place(condition.h_m, 0.0, 0.0, (condition.V_m_s, 0.0, 0.0))
            self.fdm.run_ic()
            for name, value in aircraft.adapter.settings.items():
                if name != _FREEZE:
                    self.set(name, value)
            if _FREEZE in aircraft.adapter.settings:
                self.fdm.run_ic()  # engines find out here whether they have fuel, and not while it is frozen
                self.set(_FREEZE, aircraft.adapter.settings[_FREEZE])
        self.propellers = Propellers(self, self.fdm.get_propulsion().get_num_engines())
        self.gust_nodes = [self.node(name) for name in _GUSTS]
        if aircraft.adapter is None:
            self.fdm.get_propulsion().init_running(-1)
        else:
            self.fdm.run_ic()
            self.propellers.start()
            for name, value in self.leaned().items():
                self.set(name, value)
        sources = [(n, *aircraft.source_of(n)) for n in (*CHANNELS, *modal_channels(self.mode_count))]
        found = [(name, prop, factor) for name, prop, factor in sources if self.has(prop)]
        self.channels = tuple(name for name, _, _ in found)
        self.factors = [factor for _, _, factor in found]
        self.channel_nodes = [self.node(str(prop)) for _, prop, _ in found]
        self.command_nodes = {n: self.node(aircraft.controls[n].command) for n in CONTROLS if n in aircraft.controls}

    def leaned(self) -> dict[str, float]:
        """Return property -> mixture of every engine, leaned for the height.

        As pilots do: a full rich one is too rich to burn at 3000 m. Starting an engine makes it full rich again.
        """
        ratio = min(1.0, self.get("atmosphere/P-psf") / _SEA_LEVEL_PSF)
        names = (f"fcs/mixture-cmd-norm[{i}]" for i in range(self.fdm.get_propulsion().get_num_engines()))
        return {name: ratio for name in names if self.has(name)}

    def _refusal(self, said: str) -> ModelError:
        """Return the error of a model that JSBSim refuses, in JSBSim's own words."""
        said = " ".join(said.split())
        message = f"JSBSim refuses the model of {self.aircraft.name}: {said}"
        missing = _NAMED_MISSING.findall(said)
        return UndefinedProperties(message, missing) if missing else ModelError(message)

    def _refuse_unknown_properties(self, read: frozenset[str]) -> None:
        """Raise ModelError if a function reads a property that nothing defines.

        JSBSim would find out only when it evaluates the function, and end the whole process when it deletes the model;
        defining the missing property lets it go in peace.
        """
        missing = sorted(name for name in read if not self._manager.hasNode(name))
        for name in missing:
            self.fdm.set_property_value(name, 0.0)
        if missing:
            raise UndefinedProperties(
                f"JSBSim refuses the model of {self.aircraft.name}: every property that a function reads must be "
                f"defined, but nothing defines {', '.join(missing)}",
                missing,
            )

    def has(self, name: str | None) -> bool:
        """Return whether the model has a property."""
        return name is not None and self._manager.hasNode(name)

    @property
    def read_by_functions(self) -> frozenset[str]:
        """The properties that a function of the model reads."""
        return self._read

    def reads(self, name: str) -> bool:
        """Return whether a function of the model reads a property."""
        return name in self._read

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

    def command(self, values: dict[str, float]) -> None:
        """Set control commands, SI."""
        for name, value in values.items():
            self.command_nodes[name].set_double_value(value / self.aircraft.controls[name].scale)

    @property
    def wind_m_s(self) -> FloatArray:
        """Velocity of the air (3,), north, east, down, m/s, that ``place`` and ``evaluate`` use."""
        return self._wind

    def set_wind(self, wind_m_s: Sequence[float]) -> None:
        """Set the velocity of the air (north, east, down, m/s) that ``place`` and ``evaluate`` use.

        JSBSim's own wind cannot be used: ``run_ic`` replaces it by a speed and direction among the initial conditions,
        which have no vertical wind. Its gust stays as it is set and adds to the wind, which is left at zero.
        """
        self._wind = np.array(wind_m_s, float)
        for node, value in zip(self.gust_nodes, self._wind, strict=True):
            node.set_double_value(value / FT_M)

    def place(self, h_m: float, theta: float, phi: float, uvw_m_s: Any, pqr: Any = (0.0, 0.0, 0.0)) -> None:
        """Set the initial conditions: ``uvw_m_s`` is the airspeed in body axes; heading north.

        Attitude before velocity: JSBSim keeps body velocities, which are those over the ground, only in that order.
        """
        if self._wind.any():
            uvw_m_s = np.asarray(uvw_m_s, float) + body_from_earth(theta, phi) @ self._wind
        self.set("ic/h-sl-ft", h_m / FT_M)
        self.set("ic/psi-true-rad", 0.0)
        self.set("ic/theta-rad", theta)
        self.set("ic/phi-rad", phi)
        for axis, value in zip("uvw", uvw_m_s, strict=True):
            self.set(f"ic/{axis}-fps", value / FT_M)
        for axis, value in zip("pqr", pqr, strict=True):
            self.set(f"ic/{axis}-rad_sec", value)

    def place_at(self, condition: FlightCondition, alpha: float = 0.0) -> None:
        """Place it on the flight path of a condition at an angle of attack, rad, wings level, nothing turning."""
        self.place(condition.h_m, alpha + condition.gamma_rad, 0.0, velocity_at(condition.V_m_s, alpha))

    def place_state(self, at: Mapping[str, float]) -> None:
        """Place it where the states of a linear model have the body."""
        self.place(at["h"], at["theta"], at["phi"], [at[n] for n in "uvw"], [at[n] for n in "pqr"])

    def evaluate(self, to_rest: bool = False, held: bool = False) -> None:
        """Evaluate all forces at the initial conditions, time standing still, propellers at their equilibrium.

        Repeated because the control system runs before the airspeed of the new state is known (thrust falls with
        airspeed), and because lift that depends on alphadot, and the static deflection of the modes, close loops over
        the evaluation before. ``to_rest`` repeats until no bit changes any more. ``held`` keeps the speeds of the
        propellers.
        """
        try:
            for _ in range(self.to_rest if to_rest else self._iterations):
                self.fdm.run_ic()
        except RuntimeError as error:
            raise self._refusal(self.stopped(error)) from error
        if len(self.propellers):
            if held:
                self.propellers.hold()
            else:
                self.propellers.settle()
                if to_rest:
                    self.propellers.rest(self.to_rest)

    def stopped(self, error: RuntimeError) -> str:
        """Return why JSBSim stopped, in its words, and let the model go in peace.

        A model that stands where its functions have no value ends the whole process when it is deleted: it goes back to
        where it began, or is never deleted.
        """
        try:
            self.fdm.run_ic()
        except RuntimeError:
            ctypes.pythonapi.Py_IncRef(ctypes.py_object(self.fdm))
        return " ".join(_OF_FILE.sub("", str(error)).split()).rstrip(".")

    @contextmanager
    def still(self) -> Iterator[None]:
        """Let frames pass inside in which the aircraft does not move; control system and engines do."""
        for node in self._integrators:
            node.set_double_value(_NONE)
        try:
            yield
        finally:
            for node in self._integrators:
                node.set_double_value(ADAMS_BASHFORTH_3)

    def engine_state(self) -> str:
        """Return in words what the first engine does as it stands."""
        engine = "propulsion/engine"
        if not self.has(f"{engine}/thrust-lbs"):
            return "it has no engine"
        thrust = self.get(f"{engine}/thrust-lbs") * LBF_N
        turns = self.get(f"{engine}/propeller-rpm") if self.has(f"{engine}/propeller-rpm") else 0.0
        running = "runs" if self.get(f"{engine}/set-running") or turns >= 1.0 else "does not run"
        rpm = f" at {turns:.0f} rpm" if self.has(f"{engine}/propeller-rpm") else ""
        power = f", {self.get(f'{engine}/power-hp') * HP_W / 1e3:.0f} kW" if self.has(f"{engine}/power-hp") else ""
        share = ""
        if rpm and power and self.get(f"{engine}/power-hp") > 0.0:
            useful = thrust * self.get("velocities/vt-fps") * FT_M / (self.get(f"{engine}/power-hp") * HP_W)
            share = f", {100.0 * useful:.0f} % of its power"
        return f"engine 0 {running}{rpm}{power} and gives {thrust:.3g} N{share}"

    def read(self) -> dict[str, float]:
        """Return every channel of the current state, SI."""
        values = (node.get_double_value() * f for node, f in zip(self.channel_nodes, self.factors, strict=True))
        return dict(zip(self.channels, values, strict=True))


def velocity_at(V_m_s: float, alpha: float, beta: float = 0.0) -> FloatArray:
    """Return the airspeed (3,) in body axes, m/s, at an angle of attack and of sideslip, rad."""
    uvw = np.array([V_m_s * np.cos(alpha), 0.0, V_m_s * np.sin(alpha)])
    if beta:
        uvw = np.array([uvw[0] * np.cos(beta), V_m_s * np.sin(beta), uvw[2] * np.cos(beta)])
    return uvw


def body_from_earth(theta: float | FloatArray, phi: float | FloatArray) -> FloatArray:
    """Return the matrix that takes north, east, down to body axes, heading north (Etkin 1972, section 4.4).

    It has the shape (3, 3), or (3, 3, n) of angles (n,).
    """
    s, c, sp, cp = np.sin(theta), np.cos(theta), np.sin(phi), np.cos(phi)
    return np.array([[c, np.zeros_like(c), -s], [sp * s, cp, sp * c], [cp * s, -sp, cp * c]])


ModelKey = Keyed[tuple[Aircraft, float, FlightCondition]]


def model_key(aircraft: Aircraft, rate_hz: float, condition: FlightCondition) -> ModelKey:
    """Return the key of the model that an executive with these arguments loads."""
    # a rigid model fits every speed
    design = (condition.qbar_Pa, condition.V_m_s) if aircraft.flown_modes() else None
    return Keyed((aircraft, rate_hz, condition), (*aircraft.contents, rate_hz, design))


@lru_cache(maxsize=64)
def _model(key: ModelKey) -> tuple[bytes, frozenset[str]]:
    """Return the text of a model and the properties that its functions read."""
    aircraft, rate_hz, condition = key.it
    tree = aircraft.model_tree(rate_hz, condition.qbar_Pa, condition.V_m_s)
    read = {(e.text or "").strip().lstrip("-") for tag in ("property", "p") for e in tree.iter(tag)}
    # Text encoded as a whole: an encoding given to ElementTree is taken up anew for every word of it.
    text = '<?xml version="1.0" encoding="utf-8"?>\n' + ET.tostring(tree, encoding="unicode")
    return text.encode(), frozenset(read - {""})


_LAW = "models for JSBSim must go to a temporary folder that can be written to"
_FIX = "free space, or set TMPDIR to another folder"


class _Written:
    """A model on disk, where JSBSim finds it.

    The file is removed with this object, by the process that made it: forked ones leave it be.

    Attributes:
        root: folder that JSBSim starts from.
        name: of the model.
        properties: those that its functions read.
    """

    def __init__(self, key: ModelKey) -> None:
        text, self.properties = _model(key)
        self.root = _root(os.getpid(), temporary(), key.it[0].engines).name
        self.name = f"model-{next(_NUMBERS)}"
        path = Path(self.root) / "aircraft" / f"{self.name}.xml"
        write_file(path, text, _LAW, _FIX)
        weakref.finalize(self, self._remove, path, os.getpid())

    @staticmethod
    def _remove(path: Path, owner: int) -> None:
        if os.getpid() == owner:
            path.unlink(missing_ok=True)


_NUMBERS = itertools.count()


@cache
def _root(process: int, place: str, engines: tuple[tuple[str, str], ...]) -> Scratch:
    """Return the folder of all models of a process that have the same engines, for as long as the process lives."""
    root = Scratch()
    (Path(root.name) / "aircraft").mkdir()
    (Path(root.name) / "engine").mkdir()
    for name, engine in engines:
        write_file(Path(root.name) / "engine" / name, engine, _LAW, _FIX)
    return root


@lru_cache(maxsize=64)
def _write(key: ModelKey) -> _Written:
    """Write a model; kept, as the same one is loaded for trim, flight and linearisation."""
    return _Written(key)


if hasattr(os, "register_at_fork"):
    # The process that a fork came from removes its folders when it needs them no more, whoever else does.
    os.register_at_fork(after_in_child=_write.cache_clear)
