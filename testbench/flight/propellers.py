"""Propellers while time stands still: their speed at equilibrium, or put where it is wanted.

JSBSim has no property that sets the speed of a propeller. It moves only with time,

    omega+ = omega + omegadot dt,   omegadot = (power of the engine - power of the propeller) / (omega inertia)

by one step of Euler's rule in every frame (source of FGPropeller, JSBSim 1.3.3). The length of a frame is ours to
choose, however: one frame of the right length, backwards in time if need be, takes the speed to any value, and the
initial conditions then put everything else back. So the balance of powers is solved for the speeds, by Newton's method
a frame at a time, and frames of a nanosecond, in which nothing else moves, are the judge of it.

JSBSim has a search of its own, in frames of half a second: it goes with propellers that take seconds to change their
speed, and with those alone; small ones (0.1 s) it leaves standing or at millions of rpm. It is made only where the
propellers are slow enough for it, and kept only where the judge finds them at rest.

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
from numpy.typing import NDArray

from testbench.core.constants import FT_M, JSBSIM_LENGTH_M, RPM_RAD_S, SLUG_FT2
from testbench.core.record import FloatArray

if TYPE_CHECKING:
    from testbench.flight.executive import Executive

BoolArray = NDArray[np.bool_]
_INSTANT_S = 1e-9  # a frame in which nothing moves at all
_HISTORY = 4  # frames that the integrators remember
_SETTLED = 1e-10  # of the speed
_HP_FTLB_S = 550.0
_ITERATIONS, _ROUNDS = 80, 5
_GIVEN_UP = 3  # searches without rest, after which each is one round only
_FRAME_S, _SHORTEST_S, _LONGEST_S = 0.02, 1e-3, 5.0
_SHORTEST_OF_MOTORS_S = 1e-7
_MOST_CHANGE, _MOST_CHANGE_OF_MOTORS = 0.15, 0.5  # of a speed in one frame
_SEARCHES, _STIFF_1_S = 3, -3.0  # of JSBSim's own search, whose frames of 0.5 s go with slow propellers only
_BALANCED_1_S = 1e-9  # change of a speed, of itself, that the judge of a search accepts
LEAST_INERTIA = 1e-6  # slug ft2: JSBSim takes it for a propeller that has less (source of FGPropeller, 1.3.3)
_MOTORS = ("electric", "brushless_dc_motor")
_STANDS = 1.0  # rpm, and rpm/s, of a propeller that nothing turns
_TURNING, _SPINS, _SPIN_S = 0.7, 9, 1.0  # advance ratio at which what stands is made to turn; frames until it does
_MISSED = 0.02  # of a speed, by which a frame may miss the one expected before frames are made shorter
_TRUSTED_S = 0.25  # first frame that may fill a manifold, which lags by a second or so
_MOVED, _MOVED_AT_ALL = 1e-3, 1e-7  # of a speed, by which it must change to tell how a rate follows it
_QUICK_S = 0.1  # shortest time constant of a piston engine's speed; frames twice as long still come to rest
_CAREFUL, _FIRST_S = 0.01, 0.05  # a change of throttle, and the first frame after it
_MOST_TURN_DEG = 5.0
_TURN_DEG = 0.05  # by which blades are turned to see what it changes
_START_DEG = (0.0, 5.0, 10.0, 20.0)  # above the fine stop, where an engine is started


@dataclass(frozen=True)
class _Propeller:
    """What the file of an engine and its propeller says: stops (deg), speeds (rpm), inertia (slug ft2), diameter (ft),
    N1 (%), lag of the manifold pressure, torque (lb ft) above which JSBSim takes the throttle back."""

    kind: str = ""
    low: float = 0.0
    high: float = 0.0
    least_rpm: float = 0.0
    most_rpm: float = 0.0
    inertia: float = 1.0
    diameter: float = 1.0
    idle_n1: float = 30.0
    most_n1: float = 100.0
    lag_s: float = 0.0
    torque_limit: float = 0.0


@dataclass(frozen=True)
class _Governor:
    """What governors want: which of the propellers have one, the stops of their blades (deg), the speeds (rpm)."""

    governed: BoolArray
    low: FloatArray
    high: FloatArray
    wanted: FloatArray

    def stopped(self, pitch: FloatArray, away: FloatArray, scale: FloatArray) -> BoolArray:
        """Return which speeds no blade can change: not governed, or at the stop beyond which the wanted one lies."""
        fine, coarse = (pitch <= self.low) & (away > scale), (pitch >= self.high) & (away < -scale)
        return np.asarray(~self.governed | fine | coarse)


@dataclass
class _Frames:
    """How long a frame may be, as found from frame to frame; kept from one search to the next."""

    slowing: FloatArray  # d rate / d speed (n,), 1/s
    lag: float  # of the manifold, s: a frame as long as that fills it at once
    fill: float  # longest frame that ends where it should, s; at first the lag of the manifold
    share: float = 1.0  # of the way to the speed wanted that blades are turned for; the manifold goes the rest
    longest: float = 0.0  # that is allowed now, s
    searches: int = 0  # JSBSim's own, made in this search
    fresh: bool = False  # manifolds have filled to what the throttle wants, which they do only in a frame
    trusted: float = 0.0  # longest frame that may fill the manifold yet, s; throttles may show some frames late
    # length of a frame in which the manifold, as it fills, takes a speed off by no more than it may miss, s
    filling: float = 0.0
    filled: int = 0  # frames that filled the manifold in this search; -1 if none may
    motors: bool = False  # drive all of them: quick, and nothing lags behind them

    def begin(self, careful: bool, may_fill: bool) -> None:
        """Begin a search; ``careful`` after a change of throttle, as the manifold changes the power within a frame."""
        self.filled = 0 if may_fill else -1
        self.longest = min(self.fill, _FIRST_S) if careful else self.fill
        self.searches, self.fresh, self.trusted, self.filling = 0, False, max(_TRUSTED_S, 3.0 * self.fill), 0.0

    @property
    def full(self) -> bool:
        """Whether frames are as long as they ever may be."""
        return self.longest == self.fill

    def may_search(self) -> bool:
        """Return whether JSBSim's own search may be made, whose frames of 0.5 s go with slow propellers only."""
        return self.searches < _SEARCHES and bool(np.min(self.slowing) > _STIFF_1_S) and self.full

    def fills(self, stopped: BoolArray) -> bool:
        """Return whether the next frame is a long one, which fills the manifold; the one after mends the speed.

        Long frames one after the other would swing: a manifold fills by the speed that was there before. Where one has
        taken blades to a stop, the next would take them off it again.
        """
        at_stop = bool(np.any(stopped))
        if at_stop and self.filled:
            self.filled = -1
        return self.filled >= 0 and not at_stop and self.full and self.filling > 2.0 * self.fill

    def learn_filling(self, missed: float) -> None:
        """Trust longer or shorter frames to fill the manifold, by the share of a speed by which one missed."""
        self.filled += 1
        self.trusted *= 2.0 if missed < 3.0 * _MISSED else 0.5
        self.filling = 0.0

    def length(self, rpm: FloatArray, rates: FloatArray, stopped: BoolArray) -> float:
        """Return the length of the next frame, s: the time constant of the fastest speed that no blade holds."""
        dt = self.longest
        if np.any(stopped):
            k = int(np.argmax(np.where(stopped, np.abs(rates), -1.0)))
            dt = -1.0 / self.slowing[k]
            if not self.full:
                dt = min(dt, self.longest)
        fastest = float(np.max(np.abs(rates) / np.maximum(rpm, 1.0)))
        most = _MOST_CHANGE_OF_MOTORS if self.motors else _MOST_CHANGE
        return float(max(min(dt, most / fastest if fastest else dt), self.shortest))

    @property
    def shortest(self) -> float:
        """Shortest frame of a search, s."""
        return _SHORTEST_OF_MOTORS_S if self.motors else _SHORTEST_S

    def learn_share(
        self, dt: float, before: FloatArray, after: FloatArray, stopped: BoolArray, scale: FloatArray
    ) -> None:
        """Learn the share of blades from how far from the speed wanted a frame began and ended, rpm."""
        k = int(np.argmax(np.where(stopped, 0.0, np.abs(before))))
        if self.longest == self.fill == dt and abs(before[k]) > 10.0 * scale[k] and not stopped[k]:
            self.share = float(np.clip(self.share + after[k] / before[k], 0.1, 1.0))

    def learn_length(self, dt: float, missed: float) -> None:
        """Make frames longer or shorter by the share of a speed by which one missed the end expected."""
        if missed < _MISSED:
            self.longest = min(2.0 * self.longest, self.fill)
            # The power changes by the time that the manifold fills, and the speed by the power and that time.
            reached = dt * math.sqrt(_MISSED / max(missed, _SETTLED))
            self.filling = min(self.lag, self.trusted, reached)
        else:
            self.filling = 0.0
            if dt > _FIRST_S:
                self.fill = max(0.5 * dt, min(self.fill, _FIRST_S))
            self.longest = max(0.25 * self.longest, min(self.fill, _FIRST_S))

    def learn_slowing(self, rpm: FloatArray, change: FloatArray, rates: FloatArray) -> None:
        """Learn d rate / d speed from the change of speeds, rpm, and of rates, rpm/s, over a frame.

        Where speeds hardly change, rates change by what still flows into a manifold that lags.
        """
        moved, most = (_MOVED, 1.0 / _QUICK_S) if self.lag > _FRAME_S else (_MOVED_AT_ALL, 1.0 / self.shortest)
        far = np.abs(change) > moved * np.abs(rpm)
        found = np.divide(rates, change, out=np.zeros(len(rpm)), where=far)
        self.slowing = np.where(found < 0.0, np.clip(found, -most, -1.0 / _LONGEST_S), self.slowing)


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
        self._files = _files(fdm.aircraft.xml, fdm.aircraft.engines) if self._numbers else ()
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
        self._throttles: FloatArray | None = None
        self._failed = 0  # searches for rest, one after the other
        self._motors = np.array([self._file(i).kind in _MOTORS for i in self._numbers], bool)
        told = np.array([self._has(i, "power-hp") for i in self._numbers], bool)
        self._seen = self._motors | ~told  # what only frames tell
        self._slow = not (
            self.governed or self._turboprops or np.any(self._motors)
        )  # enough for JSBSim's own search, as far as is known
        fill = max([_FRAME_S, *(self._file(i).lag_s for i in self._numbers)])
        motors = len(self) > 0 and bool(np.all(self._motors))
        self._frames = _Frames(np.full(len(self), -1.0 / _FRAME_S), fill, fill, motors=motors)

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

    def quickness(self) -> dict[int, tuple[float, float]]:
        """Return engine -> inertia of its propeller, kg m2, and rate at which its speed last came to rest, 1/s.

        Of motors alone; others drive propellers that are heavy enough for their speed to take a second or so.
        """
        found = zip(self._numbers, self._motors, self._frames.slowing, strict=True)
        return {i: (self._file(i).inertia * SLUG_FT2, -float(rate)) for i, motor, rate in found if motor}

    def start(self) -> None:
        """Start the engines in flight; the model must be placed at speed.

        JSBSim lets an engine run up in frames of half a second, in which a governor turns its blades from stop to stop
        and stalls it: it is held still meanwhile. A motor needs no start, and its propeller no run of that kind.
        """
        if len(self) and np.all(self._motors):
            return
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
        """Return whether a piston engine stands still."""
        pistons = [k for k, i in enumerate(self._numbers) if self._file(i).kind == "piston"]
        return any(self._nodes[k].get_double_value() < 1.0 for k in pistons)

    def _spin(self) -> None:
        """Make propellers turn that stand, at full throttle: air takes hold only of what turns."""
        standing = ~np.isin(np.arange(len(self)), self._governed) & (self.speeds() < 1.0)
        if not np.any(standing):
            return
        names = [f"fcs/throttle-{way}-norm[{i}]" for i in self._numbers for way in ("cmd", "pos")]
        names += [c.command for n, c in self._fdm.aircraft.controls.items() if n == "thr"]
        before = {n: self._fdm.get(n) for n in names if self._fdm.has(n)}
        diameters = np.array([self._file(i).diameter for i in self._numbers])
        wanted = self._fdm.get("velocities/u-aero-fps") / (_TURNING * diameters) * 2.0 * math.pi
        for _ in range(_SPINS):
            for name in before:
                self._fdm.set(name, 1.0)
            speeds = self.speeds()
            self._march(_INSTANT_S)
            gained = np.maximum(np.abs(self.speeds() - speeds) / _INSTANT_S, 1e-12)
            slow = standing & (speeds < 0.5 * wanted)
            if not np.any(slow):
                break
            # None of those that turn already may change by more than a part of its speed.
            room = np.where(slow, wanted - speeds, _MOST_CHANGE_OF_MOTORS * speeds)
            self._march(float(min(np.min(room / gained), _SPIN_S)))
        for name, value in before.items():
            self._fdm.set(name, value)

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
        """Bring every propeller to the speed at which engine and air turn it with the same torque."""
        if not len(self):
            return
        if not self._searched() and not np.any(self._seen & ~self._motors):
            # Where manifolds and blades chase each other, a fresh start gets nearer; where several in turn came to no
            # rest, each goes on from where the last one ended.
            for i in range(_ROUNDS if self._failed < _GIVEN_UP else 1):
                if self._balance(may_fill=i == 0):
                    self._failed = 0
                    break
            else:
                self._failed += 1
        self.hold()

    def _searched(self) -> bool:
        """Return whether JSBSim's own search has brought the propellers to rest; it is made where they are slow."""
        if not self._slow or self._stands():
            return False
        self._fdm.fdm.get_propulsion().get_steady_state()
        rpm, rates = self._look()
        self._fdm.fdm.run_ic()
        self._slow = not self._stands()  # or the search has stalled an engine
        return self._slow and bool(np.all(np.abs(rates) <= _BALANCED_1_S * np.maximum(rpm, 1.0)))

    def rest(self, times: int) -> None:
        """Evaluate all forces again at the speeds found: what loops over evaluations has still those before in it.

        Turboprops are left as they are held, since they give nothing while time stands still.
        """
        if not self._turboprops:
            for _ in range(times):
                self._fdm.fdm.run_ic()

    def hold(self) -> None:
        """Let engines give the power of their throttle, speeds held, where they would not while time stands still."""
        if self._turboprops:
            self._march(_INSTANT_S)
            self._spool()
            for _ in range(_HISTORY):
                self._march(_INSTANT_S)

    def _balance(self, may_fill: bool) -> bool:
        """Seek speeds and blade angles at which nothing changes; return whether they were found.

        The manifold of a piston engine fills by the speed that was there before a frame and moves the speed itself; the
        share of the way that blades are turned for is what is left of it, and found from frame to frame. Where frames
        have to be short for that, a long one now and then fills the manifold, if one ``may_fill`` it
        (:meth:`_Frames.fills`).

        Newton's method, a frame at a time: blades that can are turned so that the frame ends at the speed wanted;
        where they are at a stop, the length of the frame is the time constant of the speed, which makes Euler's rule a
        step of Newton's.
        """
        governor, frames = self._governor(), self._frames
        rpm, rates = self._begin(governor, may_fill)
        found_rest = False
        for _ in range(_ITERATIONS):
            pitch = self._pitch()
            scale = _SETTLED * np.maximum(np.abs(rpm), 1.0)
            away = governor.wanted - rpm
            stopped = governor.stopped(pitch, away, scale)
            still = np.abs(rates) <= scale * np.where(self._motors, np.maximum(1.0, np.abs(frames.slowing)), 1.0)
            at_rest = np.all(stopped | (np.abs(away) <= scale)) and np.all(
                still | ((rpm < _STANDS) & (rates < _STANDS))
            )
            if self._stands() or (frames.fresh and frames.full and at_rest):
                found_rest = True
                break
            filling = frames.fills(stopped)
            aim_s, share = (frames.filling, 1.0) if filling else (frames.longest, frames.share)
            was, before = self._turn_blades(governor, pitch, share * away / aim_s, rpm, rates)
            dt = aim_s if filling else frames.length(was, before, stopped)
            self._pass(dt, stopped)
            rpm, rates = self._look()
            missed = float(np.max(np.abs(rpm - was - before * dt) / np.maximum(was, 1.0)))
            if filling:
                frames.learn_filling(missed)
                continue
            frames.learn_share(dt, away, governor.wanted - rpm, stopped, scale)
            frames.learn_length(dt, missed)
            frames.learn_slowing(rpm, rpm - was, rates - before)
        self._govern(True)
        self._fdm.fdm.run_ic()
        self._slow = self._slow and bool(np.min(frames.slowing) > _STIFF_1_S)
        return found_rest

    def _governor(self) -> _Governor:
        """Return the speeds that the levers ask for and the stops of the blades."""
        files = [self._file(i) for i in self._numbers]
        advance = [f"fcs/advance-cmd-norm[{i}]" for i in self._numbers]
        levers = [self._fdm.get(n) if self._fdm.has(n) else 1.0 for n in advance]
        wanted = [f.least_rpm + (f.most_rpm - f.least_rpm) * a for f, a in zip(files, levers, strict=True)]
        return _Governor(
            np.isin(np.arange(len(self)), self._governed),
            np.array([f.low for f in files]),
            np.array([f.high for f in files]),
            np.array(wanted),
        )

    def _begin(self, governor: _Governor, may_fill: bool) -> tuple[FloatArray, FloatArray]:
        """Make the engines ready for a search, governors off; return speeds (n,), rpm, and their rates, rpm/s."""
        if self._stands():
            levers = [n for i in self._numbers for n in (f"fcs/throttle-cmd-norm[{i}]", f"fcs/mixture-cmd-norm[{i}]")]
            before = {n: self._fdm.get(n) for n in levers if self._fdm.has(n)}
            self.start()  # which opens them
            for name, value in before.items():
                self._fdm.set(name, value)
        self._govern(False)
        if self._turboprops:
            self._march(_INSTANT_S)
            self._spool()
        elif not self._slow:
            self._spin()
        rpm, rates = self._look()
        if self._slope is None:
            self._slope = self._turned(rates, governor.low, governor.high)
            rpm, rates = self._look()
        throttles = np.array([self._fdm.get(f"fcs/throttle-pos-norm[{i}]") for i in self._numbers])
        careful = self._throttles is None or bool(np.max(np.abs(throttles - self._throttles)) > _CAREFUL)
        self._throttles = throttles
        self._frames.begin(careful, may_fill)
        return rpm, rates

    def _turn_blades(
        self, governor: _Governor, pitch: FloatArray, wanted: FloatArray, rpm: FloatArray, rates: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Turn governed blades from ``pitch`` for the rates wanted, rpm/s; return speeds and rates thereafter."""
        assert self._slope is not None
        turned = pitch.copy()
        for k in self._governed:
            step = (wanted[k] - rates[k]) / self._slope[k] if self._slope[k] else 0.0
            step = np.clip(step, -_MOST_TURN_DEG, _MOST_TURN_DEG)
            turned[k] = np.clip(pitch[k] + step, governor.low[k], governor.high[k])
        self._set_pitch(turned)
        moved = turned - pitch
        if not np.any(moved):
            return rpm, rates
        rpm, after = self._look()
        slope = np.divide(after - rates, moved, out=np.zeros(len(self)), where=np.abs(moved) > 1e-6)
        self._slope = np.where(slope < 0.0, slope, self._slope)
        return rpm, after

    def _pass(self, dt_s: float, stopped: BoolArray) -> None:
        """Let a frame pass; where no blades turn and speeds are slow, JSBSim's own search in its place, a few times."""
        if np.all(stopped) and not self._turboprops and self._frames.may_search():
            self._frames.searches += 1
            self._fdm.fdm.get_propulsion().get_steady_state()
        else:
            self._march(dt_s)
        self._frames.fresh = True
        if self._turboprops:
            self._spool()

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
        """Return speeds (n,), rpm, and their rates of change, rpm/s.

        The rates of motors, and of what tells no power, are seen in a short frame: the power that JSBSim tells of a
        brushless one is 3e-5 off.
        """
        before, dt = self.speeds(), self.GLANCE_S if np.any(self._seen) else _INSTANT_S
        self._march(dt)
        rpm = np.array([node.get_double_value() for node in self._nodes])
        told = [0.0 if seen else self._node(k, "power-hp").get_double_value() for k, seen in enumerate(self._seen)]
        given = np.array(told) * _HP_FTLB_S
        taken = np.array([self._node(k, "propeller-power-ftlbps").get_double_value() for k in range(len(self))])
        omega = np.maximum(rpm * RPM_RAD_S, 0.01)
        inertia = np.array([self._file(i).inertia for i in self._numbers])
        seen = (rpm * RPM_RAD_S - before) / dt
        return rpm, np.where(self._seen, seen, (given - taken) / omega / inertia) / RPM_RAD_S

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
        factor = 1.0 / SLUG_FT2 if unit == "KG*M2" else 1.0
        diameter = None if file is None else file.find("diameter")
        size = "FT" if diameter is None else diameter.get("unit", "FT").upper()
        out.append(
            _Propeller(
                kind,
                numbers["minpitch"],
                numbers["maxpitch"],
                numbers["minrpm"],
                numbers["maxrpm"],
                max(_number(file, "ixx", 1.0) * factor, LEAST_INERTIA),
                _number(file, "diameter", 1.0) * JSBSIM_LENGTH_M.get(size, FT_M) / FT_M,
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
