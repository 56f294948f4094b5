"""Propellers while time stands still: their speed at equilibrium, or put where it is wanted.

JSBSim has no property that sets the speed of a propeller. It moves only with time,

    omega+ = omega + omegadot dt,   omegadot = (power of the engine - power of the propeller) / (omega inertia)

by one step of Euler's rule in every frame (source of FGPropeller, JSBSim 1.3.3). The length of a frame is ours to
choose, however: one frame of the right length, backwards in time if need be, takes the speed to any value, and the
initial conditions then put everything else back.

A governor turns the blades by (speed - wanted speed) dt in every frame, between two stops. At rest the speed is the one
wanted, or the blades are at a stop. Here the governor is switched off meanwhile and the angle of the blades is sought
that gives both; with the governor switched on again, frames of a flight change nothing any more.

A turboprop gives no power while time stands still, and afterwards begins at idle. Its gas generator is therefore put
where the throttle wants it (N1 = idle + throttle (most - idle)), and forces are read after frames of a nanosecond.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from testbench.core.constants import RPM_RAD_S
from testbench.core.record import FloatArray

if TYPE_CHECKING:
    from testbench.flight.executive import Executive

_INSTANT_S = 1e-9  # a frame in which nothing moves at all
_HISTORY = 4  # frames that the integrators remember
_SETTLED = 1e-10  # of the speed
_HP_FTLB_S = 550.0
_ITERATIONS, _ROUNDS = 80, 5
_FRAME_S, _SHORTEST_S, _LONGEST_S = 0.02, 1e-3, 5.0
_MOST_CHANGE = 0.15  # of a speed in one frame
_SEARCHES, _STIFF_1_S = 3, -3.0  # of JSBSim's own search, whose frames of 0.5 s go with slow propellers only
_MISSED = 0.02  # of a speed, by which a frame may miss the one expected before frames are made shorter
_CAREFUL, _FIRST_S = 0.01, 0.05  # a change of throttle, and the first frame after it
_MOST_TURN_DEG = 5.0
_TURN_DEG = 0.05  # by which blades are turned to see what it changes
_START_DEG = (0.0, 5.0, 10.0, 20.0)  # above the fine stop, where an engine is started


@dataclass(frozen=True)
class _Propeller:
    """What the file of an engine and its propeller says: stops (deg), speeds (rpm), inertia (slug ft2), N1 (%),
    lag of the manifold pressure, torque (lb ft) above which JSBSim takes the throttle back."""

    kind: str = ""
    low: float = 0.0
    high: float = 0.0
    least_rpm: float = 0.0
    most_rpm: float = 0.0
    inertia: float = 1.0
    idle_n1: float = 30.0
    most_n1: float = 100.0
    lag_s: float = 0.0
    torque_limit: float = 0.0


class Propellers:
    """The propellers of a model.

    Args:
        fdm: executive that holds the model.
        count: number of engines.
    """

    GLANCE_S = 1e-6  # a frame so short that nothing moves, from which a rate is read

    def __init__(self, fdm: Executive, count: int) -> None:
        self._fdm = fdm
        names = [f"propulsion/engine[{i}]/propeller-rpm" for i in range(count)]
        self._numbers = [i for i, name in enumerate(names) if fdm.has(name)]
        self._nodes = [fdm.node(names[i]) for i in self._numbers]
        engines = tuple(sorted(fdm.aircraft.engine_files.items()))
        self._files = _files(fdm.aircraft.xml, engines) if self._numbers else ()
        modes = [f"propulsion/engine[{i}]/constant-speed-mode" for i in self._numbers]
        turns = [self._file(i).high > self._file(i).low for i in self._numbers]
        adapted = fdm.aircraft.adapter is not None
        self._governed = [
            k
            for k, (i, name) in enumerate(zip(self._numbers, modes, strict=True))
            if adapted and turns[k] and fdm.has(name) and fdm.get(name) != 0.0 and self._has(i, "power-hp")
        ]
        self._turboprops = [i for i in self._numbers if adapted and self._file(i).kind == "turboprop"]
        self._slope: FloatArray | None = None
        self._slowing: FloatArray | None = None
        self._throttles: FloatArray | None = None
        self._share, self._fill = 1.0, 0.0

    def __len__(self) -> int:
        return len(self._nodes)

    def _file(self, engine: int) -> _Propeller:
        return self._files[engine] if engine < len(self._files) else _Propeller()

    def _has(self, engine: int, name: str) -> bool:
        return self._fdm.has(f"propulsion/engine[{engine}]/{name}")

    def _node(self, k: int, name: str) -> Any:
        return self._fdm.node(f"propulsion/engine[{self._numbers[k]}]/{name}")

    @property
    def governed(self) -> bool:
        """Whether a governor keeps the speed of any of them by the angle of its blades."""
        return bool(self._governed)

    @property
    def free(self) -> bool:
        """Whether the speeds follow from throttle and airspeed alone, neither governed nor behind a gas generator."""
        return len(self) > 0 and not self.governed and not self._turboprops

    def speeds(self) -> FloatArray:
        """Return the speeds (n,), rad/s."""
        return np.array([node.get_double_value() for node in self._nodes]) * RPM_RAD_S

    def start(self) -> None:
        """Start the engines in flight; the model must be placed at speed.

        JSBSim lets an engine run up in frames of half a second, in which a governor turns its blades from stop to stop
        and stalls it: it is held still meanwhile.
        """
        self._govern(False)
        for above in _START_DEG:
            for k in self._governed:
                file = self._file(self._numbers[k])
                self._node(k, "blade-angle").set_double_value(min(file.low + above, file.high))
            self._fdm.fdm.get_propulsion().init_running(-1)
            if not self._stands():
                break
        else:
            for i in self._numbers:
                self._fdm.fdm.get_propulsion().get_engine(i).init_running()
        self._throttles = None
        self._govern(True)

    def _stands(self) -> bool:
        """Return whether a piston engine with a governed propeller stands still."""
        pistons = [k for k in self._governed if self._file(self._numbers[k]).kind == "piston"]
        return any(self._nodes[k].get_double_value() < 1.0 for k in pistons)

    def limited(self) -> str:
        """Return in words that the torque limiter of an engine is at work, "" if none is."""
        for k, i in enumerate(self._numbers):
            limit = self._file(i).torque_limit
            power = self._node(k, "power-hp").get_double_value() if limit > 0.0 else 0.0
            torque = power * _HP_FTLB_S / max(self._nodes[k].get_double_value() * RPM_RAD_S, 0.01)
            if torque > limit > 0.0:
                return (
                    f"JSBSim's torque limiter leaves engine {i}: it takes the throttle back above {limit:.0f} lb ft "
                    f"(ielumaxtorque of the engine's file) at the propeller, which takes {torque:.0f} at this throttle"
                )
        return ""

    def accelerations(self) -> FloatArray:
        """Return the rates of change of the speeds (n,), rad/s2, at the state that was placed last."""
        before = self.speeds()
        self.glance()
        return np.asarray((self.speeds() - before) / self.GLANCE_S)

    def settle(self) -> None:
        """Bring every propeller to the speed at which engine and air turn it with the same torque.

        JSBSim's own search does it where nothing turns the blades.
        """
        if not len(self):
            return
        if self.governed or self._turboprops:
            for _ in range(_ROUNDS):  # where manifolds and blades chase each other, a fresh start gets nearer
                if self._balance():
                    break
        else:
            self._fdm.fdm.get_propulsion().get_steady_state()
            self._fdm.fdm.run_ic()
        self.hold()

    def hold(self) -> None:
        """Let engines give the power of their throttle, speeds held, where they would not while time stands still."""
        if self._turboprops:
            self._march(_INSTANT_S)
            self._spool()
            for _ in range(_HISTORY):
                self._march(_INSTANT_S)

    def _balance(self) -> bool:
        """Seek speeds and blade angles at which nothing changes; return whether they were found.

        The manifold of a piston engine fills by the speed that was there before a frame and moves the speed itself; the
        share of the way that blades are turned for is what is left of it, and found from frame to frame.

        Newton's method, a frame at a time: blades that can are turned so that the frame ends at the speed wanted;
        where they are at a stop, the length of the frame is the time constant of the speed, which makes Euler's rule a
        step of Newton's.
        """
        files = [self._file(i) for i in self._numbers]
        governed = np.isin(np.arange(len(self)), self._governed)
        low = np.array([f.low for f in files])
        high = np.array([f.high for f in files])
        advance = [f"fcs/advance-cmd-norm[{i}]" for i in self._numbers]
        levers = [self._fdm.get(n) if self._fdm.has(n) else 1.0 for n in advance]
        wanted = np.array([f.least_rpm + (f.most_rpm - f.least_rpm) * a for f, a in zip(files, levers, strict=True)])
        if self._stands():
            self.start()
        self._govern(False)
        if self._turboprops:
            self._march(_INSTANT_S)
            self._spool()
        rpm, rates = self._look()
        if self._slope is None:
            self._slope = self._turned(rates, low, high)
            rpm, rates = self._look()
        fill = self._fill or max([_FRAME_S, *(self._file(i).lag_s for i in self._numbers)])
        if self._slowing is None:
            self._slowing = np.full(len(self), -1.0 / _FRAME_S)
        slowing, searches = self._slowing, 0  # d rate / d speed, 1/s
        fresh = False  # manifolds have filled to what the throttle wants only after a frame
        throttles = np.array([self._fdm.get(f"fcs/throttle-pos-norm[{i}]") for i in self._numbers])
        longest, share = fill, self._share
        if self._throttles is None or np.max(np.abs(throttles - self._throttles)) > _CAREFUL:
            longest = min(fill, _FIRST_S)  # the power changes within a frame as the manifold empties or fills
        self._throttles, found_rest = throttles, False
        for _ in range(_ITERATIONS):
            if self._stands():
                found_rest = True
                break
            pitch = self._pitch()
            scale = _SETTLED * np.maximum(np.abs(rpm), 1.0)
            away = wanted - rpm
            stopped = ~governed | ((pitch <= low) & (away > scale)) | ((pitch >= high) & (away < -scale))
            if (
                fresh
                and longest == fill
                and np.all(stopped | (np.abs(away) <= scale))
                and np.all(np.abs(rates) <= scale)
            ):
                found_rest = True
                break
            dt = longest
            turned = pitch.copy()
            for k in self._governed:
                step = (share * away[k] / dt - rates[k]) / self._slope[k] if self._slope[k] else 0.0
                turned[k] = np.clip(pitch[k] + np.clip(step, -_MOST_TURN_DEG, _MOST_TURN_DEG), low[k], high[k])
            self._set_pitch(turned)
            moved = turned - pitch
            before = rates
            if np.any(moved):
                rpm, before = self._look()
                slope = np.divide(before - rates, moved, out=np.zeros(len(self)), where=np.abs(moved) > 1e-6)
                self._slope = np.where(slope < 0.0, slope, self._slope)
            if np.any(stopped):
                k = int(np.argmax(np.where(stopped, np.abs(before), -1.0)))
                dt = -1.0 / slowing[k]
                if longest < fill:
                    dt = min(dt, longest)
            fastest = float(np.max(np.abs(before) / np.maximum(rpm, 1.0)))
            dt = max(min(dt, _MOST_CHANGE / fastest if fastest else dt), _SHORTEST_S)
            if (
                np.all(stopped)
                and not self._turboprops
                and searches < _SEARCHES
                and np.min(slowing) > _STIFF_1_S
                and longest == fill
            ):
                searches += 1
                self._fdm.fdm.get_propulsion().get_steady_state()
            else:
                self._march(dt)
            fresh = True
            was = rpm
            if self._turboprops:
                self._spool()
            rpm, rates = self._look()
            k = int(np.argmax(np.where(stopped, 0.0, np.abs(away))))
            if longest == fill == dt and abs(away[k]) > 10.0 * scale[k] and not stopped[k]:
                share = float(np.clip(share + (wanted[k] - rpm[k]) / away[k], 0.1, 1.0))
            missed = float(np.max(np.abs(rpm - was - before * dt) / np.maximum(was, 1.0)))
            if missed < _MISSED:
                longest = min(2.0 * longest, fill)
            else:
                fill = max(0.5 * dt, min(fill, _FIRST_S)) if dt > _FIRST_S and fresh else fill
                longest = max(0.25 * longest, min(fill, _FIRST_S))
            change = rpm - was
            found = np.divide(
                rates - before, change, out=np.zeros(len(self)), where=np.abs(change) > 1e-7 * np.abs(rpm)
            )
            slowing = np.where(found < 0.0, np.clip(found, -1.0 / _SHORTEST_S, -1.0 / _LONGEST_S), slowing)
        self._slowing, self._share, self._fill = slowing, share, fill
        self._govern(True)
        self._fdm.fdm.run_ic()
        return found_rest

    def _turned(self, rates: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
        """Return d rate / d blade angle (n,), rpm/s per deg."""
        pitch = self._pitch()
        step = np.where(pitch + _TURN_DEG <= high, _TURN_DEG, -_TURN_DEG)
        self._set_pitch(pitch + step)
        _, moved = self._look()
        self._set_pitch(pitch)
        return np.asarray((moved - rates) / step)

    def _pitch(self) -> FloatArray:
        return np.array([self._node(k, "blade-angle").get_double_value() for k in range(len(self))])

    def _set_pitch(self, pitch_deg: FloatArray) -> None:
        for k in self._governed:
            self._node(k, "blade-angle").set_double_value(float(pitch_deg[k]))

    def _govern(self, on: bool) -> None:
        for k in self._governed:
            self._node(k, "constant-speed-mode").set_double_value(1.0 if on else 0.0)

    def _spool(self) -> None:
        """Put gas generators where their throttles want them."""
        for i in self._turboprops:
            file = self._file(i)
            throttle = self._fdm.get(f"fcs/throttle-pos-norm[{i}]")
            self._fdm.set(f"propulsion/engine[{i}]/n1", file.idle_n1 + throttle * (file.most_n1 - file.idle_n1))

    def _look(self) -> tuple[FloatArray, FloatArray]:
        """Return speeds (n,), rpm, and their rates of change, rpm/s."""
        self._march(_INSTANT_S)
        rpm = np.array([node.get_double_value() for node in self._nodes])
        given = np.array([self._node(k, "power-hp").get_double_value() for k in range(len(self))]) * _HP_FTLB_S
        taken = np.array([self._node(k, "propeller-power-ftlbps").get_double_value() for k in range(len(self))])
        omega = np.maximum(rpm * RPM_RAD_S, 0.01)
        inertia = np.array([self._file(i).inertia for i in self._numbers])
        return rpm, (given - taken) / omega / inertia / RPM_RAD_S

    def _march(self, dt_s: float) -> None:
        """Let one frame of this length pass in which nothing moves but what turns."""
        fdm = self._fdm.fdm
        with self._fdm.still():
            fdm.set_dt(dt_s)
            fdm.run()
            fdm.set_dt(1.0 / self._fdm.rate_hz)

    def glance(self, dt_s: float = GLANCE_S) -> None:
        """Let a frame pass in which nothing but the engines moves; a very short one, if not told otherwise."""
        if self._turboprops:
            self._march(_INSTANT_S)
            self._spool()
        self._march(dt_s)
        self._fdm.fdm.run_ic()


@lru_cache(maxsize=64)
def _files(xml: str, engine_files: tuple[tuple[str, str], ...]) -> tuple[_Propeller, ...]:
    """Return what is said of every engine and its propeller; JSBSim's defaults where nothing is."""
    texts = dict(engine_files)
    tree, out = ET.fromstring(xml), []
    for element in tree.findall("propulsion/engine"):
        engine = _root(element, texts)
        thruster = element.find("thruster")
        file = None if thruster is None else _root(thruster, texts)
        kind = "" if engine is None else engine.tag.removesuffix("_engine")
        numbers = {name: _number(file, name) for name in ("minpitch", "maxpitch", "minrpm", "maxrpm")}
        inertia = None if file is None else file.find("ixx")
        unit = "SLUG*FT2" if inertia is None else inertia.get("unit", "SLUG*FT2").upper()
        factor = 1.0 / 1.35594 if unit == "KG*M2" else 1.0
        out.append(
            _Propeller(
                kind,
                numbers["minpitch"],
                numbers["maxpitch"],
                numbers["minrpm"],
                numbers["maxrpm"],
                _number(file, "ixx", 1.0) * factor,
                _number(engine, "idlen1", 30.0),
                _number(engine, "maxn1", 100.0),
                _number(engine, "man-press-lag", 1.0) if kind == "piston" else 0.0,
                _number(engine, "ielumaxtorque") if kind == "turboprop" else 0.0,
            )
        )
    return tuple(out)


def _root(element: ET.Element, texts: dict[str, str]) -> ET.Element | None:
    """Return the root of the file that an element names; of what the element itself holds if it names none."""
    text = texts.get(f"{element.get('file', '')}.xml")
    return next(iter(element), None) if text is None else ET.fromstring(text)


def _number(element: ET.Element | None, name: str, default: float = 0.0) -> float:
    text = None if element is None else element.findtext(name)
    value = default if text is None else float(text)
    return value if math.isfinite(value) else default
