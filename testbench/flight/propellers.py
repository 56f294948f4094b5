"""Propellers while time stands still: their speed at equilibrium, or put where it is wanted.

JSBSim has no property that sets the speed of a propeller. It moves only with time,

    omega+ = omega + omegadot dt,   omegadot = (torque of the engine - torque of the propeller) / inertia

by one step of Euler's rule in every frame (source of FGPropeller, JSBSim 1.3.3). The length of a frame is ours to
choose, however: one frame of the right length, backwards in time if need be, takes the speed to any value, and the
initial conditions then put everything else back.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from testbench.core.constants import RPM_RAD_S
from testbench.core.record import FloatArray

if TYPE_CHECKING:
    from testbench.flight.executive import Executive

# JSBSim's number for Adams-Bashforth of third order. Its default, Euler for the rates, costs 3 % at 8 Hz; second order
# costs 0.6 % of a modal rate at 21 to 30 Hz and 500 frames per second; fourth order is stable over half the range only.
ADAMS_BASHFORTH_3 = 4
_NONE = 0
INTEGRATORS = ("rate/rotational", "rate/translational", "position/rotational", "position/translational")
_LONGEST_S = 0.05
_FRAMES = 3000
_SETTLED = 1e-10  # of the speed, from frame to frame
_SLOW, _FAST = 0.7, 0.3  # ratios of two changes in a row, beyond which frames are made longer or shorter


class Propellers:
    """The propellers of a model.

    Args:
        fdm: executive that holds the model, engines running.
        count: number of engines.
    """

    GLANCE_S = 1e-6  # a frame so short that nothing moves, from which a rate is read

    def __init__(self, fdm: Executive, count: int) -> None:
        self._fdm = fdm
        names = [f"propulsion/engine[{i}]/propeller-rpm" for i in range(count)]
        self._numbers = [i for i, name in enumerate(names) if fdm.has(name)]
        self._nodes = [fdm.node(names[i]) for i in self._numbers]
        modes = [f"propulsion/engine[{i}]/constant-speed-mode" for i in self._numbers]
        self._governed = [fdm.has(name) and fdm.get(name) != 0.0 for name in modes]
        self._step_s: float | None = None
        self._integrators = [fdm.node(f"simulation/integrator/{name}") for name in INTEGRATORS]

    def __len__(self) -> int:
        return len(self._nodes)

    @property
    def governed(self) -> bool:
        """Whether a governor keeps the speed of any of them by the angle of its blades."""
        return any(self._governed)

    def speeds(self) -> FloatArray:
        """Return the speeds (n,), rad/s."""
        return np.array([node.get_double_value() for node in self._nodes]) * RPM_RAD_S

    def glance(self, dt_s: float = GLANCE_S) -> None:
        """Let a frame pass in which nothing but the engines moves; a very short one, if not told otherwise."""
        self._frame(dt_s)

    def accelerations(self) -> FloatArray:
        """Return the rates of change of the speeds (n,), rad/s2, at the state that was placed last."""
        before = self.speeds()
        self.glance()
        return np.asarray((self.speeds() - before) / self.GLANCE_S)

    def settle(self) -> None:
        """Bring every propeller to the speed at which engine and air turn it with the same torque.

        JSBSim's own search does it, except where a governor turns the blades by so much in every frame: its frames of
        half a second are then too long. Here they are at first as long as those of a flight, then as long as the
        motion allows.
        """
        if not len(self):
            return
        if not self.governed:
            self._fdm.fdm.get_propulsion().get_steady_state()
            self._fdm.fdm.run_ic()
            return
        frame = 1.0 / self._fdm.rate_hz
        dt, last = self._step_s or frame, 0.0
        for _ in range(_FRAMES):
            start = self.speeds()
            self._frame(dt)
            now = self.speeds()
            change = now - start
            k = int(np.argmax(np.abs(change)))
            if abs(change[k]) <= _SETTLED * max(abs(now[k]), 1.0):
                break
            ratio, was = (change[k] / last if last else 1.0), dt
            if ratio > _SLOW:
                dt = min(1.5 * dt, _LONGEST_S)
            elif ratio < _FAST:
                dt = max(0.5 * dt, 0.1 * frame)
            last = float(change[k]) * dt / was
        self._step_s = dt

    def _frame(self, dt_s: float) -> None:
        """Let one frame of this length pass in which nothing moves but what turns, and put the rest back."""
        fdm = self._fdm.fdm
        for node in self._integrators:
            node.set_double_value(_NONE)
        fdm.set_dt(dt_s)
        fdm.run()
        fdm.set_dt(1.0 / self._fdm.rate_hz)
        for node in self._integrators:
            node.set_double_value(ADAMS_BASHFORTH_3)
        fdm.run_ic()
