"""ExcitationDesign: an agent moves the controls of an aircraft so that the record tells its parameters.

Every step the agent sets the commands, which are held for ``decision_s``. It sees what the sensors show. Its reward is

    r = ln(cost before / cost after) - w max(0, (use - near) / (1 - near))^2

with the cost of a design (see :func:`testbench.information.fisher.cost`: by default the t-th root of the volume of the
targets' error ellipsoid, so that r is the gain of log det information per target, in nats) and ``use`` the largest
share of a limit that the step used up. The gains of a flight add up to ln(cost before the flight / cost after it). A
broken limit ends the episode with ``-breach_cost`` and without the gain of that step; the end of the record truncates
it.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from testbench.core.errors import MissingPackage, missing
from testbench.envs import NEEDS_GYMNASIUM

try:
    import gymnasium
except ImportError as error:
    raise MissingPackage(missing(*NEEDS_GYMNASIUM)) from error

from testbench.core.errors import LimitError, ScenarioError
from testbench.core.record import FloatArray
from testbench.envs.dynamics import JSBSimFlight, LinearFlights, Pieces
from testbench.envs.gain import Gain
from testbench.envs.lifted import lift
from testbench.envs.sensed import Display
from testbench.envs.tasks import amplitude, prepare
from testbench.information.fisher import Criterion

if TYPE_CHECKING:
    from testbench.envs.figures import Episode

Observation = NDArray[np.float32]
LEVELS = (-1.0, -0.5, 0.0, 0.5, 1.0)
"""Commands of the discrete version, in shares of the amplitude; action 0 holds the command, action i + 1 steps to i."""

RATE_TOLERANCE = 1e-6
_ONE = np.ones(1, bool)  # the one flight
_FAR = 1e4  # in units of the observation: a flight ends within the decision that takes it beyond a limit, which is 1


class ExcitationDesign(gymnasium.Env[Observation, Any]):
    """The environment ``testbench/ExcitationDesign-v0``; see the module's docstring.

    Actions: "continuous": a command per control, -1 to 1 times the amplitude; "discrete": 0 holds, i + 1 steps to
    ``LEVELS[i]``, one number per control.

    Observation, flat, float32: the last ``stack`` samples of every sensor (deviation from trim in units of its limit
    where it has one, else in tens of its noise), oldest first; the commands now, in amplitudes; the share of time left;
    and per target 1 / (1 + standard error / wanted error), 0 at first and 0.5 where the wanted accuracy is reached.

    ``info``: "cost", "use" (largest share of a limit in this step) and "t_s"; at the end also "limit" (which one was
    broken, or ""), "errors" (target -> standard error over wanted) and "largest_use".

    Args:
        task: aircraft with a task (``testbench.envs.tasks.TASKS``), or the path of a design scenario.
        actions: see above.
        dynamics: "linear", the linearised aircraft, or "jsbsim": JSBSim flies, is sensed and held to the limits, and
            sensitivities are still those of the linearised aircraft.
        wings: "rigid" or "flexible", for tasks; a scenario has its own.
        criterion: which cost: "D", "worst", "A" or "E".
        decision_s: how long a command is held; a whole number of samples of the fastest sensors. Default: the shortest
            step of the task.
        stack: samples observed.
        prior: standard error of a parameter before the flight, relative to its true value.
        near: share of a limit beyond which nearing it costs.
        near_cost: w above, nats.
        breach_cost: of a broken limit, nats.
        render_mode: None or "rgb_array".

    Attributes:
        task: what is flown.
        amplitude: (m,) command either side of trim, rad (1 for the throttle), that a full action means.
        steps: decisions of a flight.
        quiet: samples before the first decision.
        samples: of a flight.
        rate_hz: of the samples.
        lifted: one decision of the linear aircraft.
        gain: what the flight has told.
        display: how samples are shown.

    Raises:
        ScenarioError: an unknown task or option.
        LimitError: a decision that is no whole number of samples, or limits without room.
        EstimationError: targets that depend on one another, under criterion D.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 10}

    def __init__(
        self,
        task: str = "eolo",
        actions: Literal["continuous", "discrete"] = "continuous",
        dynamics: Literal["linear", "jsbsim"] = "linear",
        wings: Literal["rigid", "flexible"] = "rigid",
        criterion: Criterion = "D",
        decision_s: float | None = None,
        stack: int = 8,
        prior: float = 1.0,
        near: float = 0.9,
        near_cost: float = 1.0,
        breach_cost: float = 5.0,
        render_mode: str | None = None,
    ) -> None:
        _check(actions, dynamics, criterion, near, near_cost, breach_cost, render_mode)
        self.render_mode = render_mode
        self.task = prepare(task, wings)
        self.amplitude = amplitude(task, self.task)
        problem = self.task.problem
        experiment = problem.experiment
        rate = problem.rate_hz / experiment.stride
        self.decision_s = decision_s if decision_s is not None else math.ceil(problem.shortest_s * rate - 1e-9) / rate
        r = _whole(self.decision_s * rate, "decision_s", f"of {1.0 / rate:g} s")
        self.quiet = _whole(problem.start_s * rate, "start_s", f"of {1.0 / rate:g} s")
        if not 1 <= stack <= self.quiet:
            raise LimitError(
                f"1 <= stack <= {self.quiet}, the samples before the first decision, must hold, got {stack}"
            )
        self.steps = (experiment.samples - self.quiet) // r
        if self.steps < 1:
            raise LimitError(
                f"the record must hold at least one decision of {self.decision_s:g} s, got {problem.duration_s:g} s"
            )
        self.lifted = lifted = lift(problem, r)
        self.dynamics = dynamics
        self.criterion: Criterion = criterion
        self.near = near
        self.gain = Gain(problem, criterion, prior)
        p, k = lifted.p, lifted.k
        first = lifted.nz + lifted.r * p
        scale = np.tile(self.gain.sensitivity_scale, (lifted.r, 1, 1))
        lifted.matrix[first : first + lifted.r * p * k] *= scale.reshape(-1, 1)
        self._flight = LinearFlights(self.task, lifted) if dynamics == "linear" else JSBSimFlight(self.task, lifted)
        self.rate_hz, self.stack = rate, stack
        self.near_cost, self.breach_cost, self.discrete = near_cost, breach_cost, actions == "discrete"
        self.samples = self.quiet + self.steps * r
        self.display = Display(self.task, rate, self.samples)
        m, t = len(problem.controls), len(problem.targets.names)
        size = stack * p + m + 1 + t
        low, high = np.full(size, -_FAR, np.float32), np.full(size, _FAR, np.float32)
        low[stack * p : stack * p + m], high[stack * p : stack * p + m] = -1.0, 1.0
        low[stack * p + m :], high[stack * p + m :] = 0.0, 1.0
        self.observation_space = gymnasium.spaces.Box(low, high, dtype=np.float32)
        if not self.discrete:
            self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (m,), np.float32)
        elif m == 1:
            self.action_space = gymnasium.spaces.Discrete(len(LEVELS) + 1)
        else:
            self.action_space = gymnasium.spaces.MultiDiscrete([len(LEVELS) + 1] * m)
        self._seen, self._shown = np.empty((self.samples, p)), np.empty((self.samples, p))
        self._u = np.zeros((self.steps, m))
        self._uses = np.zeros(self.steps)
        self._costs = np.ones(self.steps + 1)
        self._step, self._over, self._largest = 0, True, 0.0
        self._now, self._left = np.zeros(m), np.ones(1)

    @property
    def commands(self) -> FloatArray:
        """(steps flown, m) commands so far, deviations from trim, rad (1 for the throttle)."""
        return self._u[: self._step].copy()

    @property
    def information(self) -> FloatArray:
        """(k, k) Fisher information of the flight so far about the parameters that are estimated."""
        return np.asarray(self.gain.information[0])

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin a flight at trim; ``seed`` decides all errors of the sensors. No options are known.

        Raises:
            ScenarioError: an option was given.
        """
        super().reset(seed=seed)
        if options:
            raise ScenarioError(f"reset takes no options, got {', '.join(options)}")
        self._drawn = self.display.draw(int(self.np_random.integers(2**31)))
        self.gain.reset(_ONE, self.quiet)
        self._seen[: self.quiet] = self._flight.start(self.quiet)
        self._measure(0, self.quiet)
        self._step, self._over, self._largest = 0, False, 0.0
        self._now = np.zeros(len(self.amplitude))
        (self._log_cost,), (self._relative,) = self.gain.known
        self._costs[0] = math.exp(self._log_cost)
        return self._observe(), {"cost": self._costs[0], "use": 0.0, "t_s": self.quiet / self.rate_hz}

    def step(self, action: Any) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Hold the commands of ``action`` for one decision.

        Raises:
            LimitError: an action outside its space, or a flight that has ended or not begun.
        """
        if self._over:
            raise LimitError("a flight must have begun and not ended when a step is taken; call reset()")
        self._now = self._level(action)
        u = self._now * self.amplitude
        piece = self._flight.fly(u[None])
        at = self.quiet + self._step * self.lifted.r
        self._seen[at : at + self.lifted.r] = piece.seen[0]
        self._measure(at, at + self.lifted.r)
        use = float(np.maximum.reduce(piece.use[0]))
        self._u[self._step], self._uses[self._step] = u, use
        self._step += 1
        broken = bool(piece.ended[0]) or not use <= 1.0
        if broken:
            reward = -self.breach_cost
        else:
            before = self._log_cost
            self.gain.add(piece.sensitivities, np.array([at]), _ONE, self.lifted.r)
            (self._log_cost,), (self._relative,) = self.gain.known
            reward = float(before - self._log_cost)
            if use > self.near:
                reward -= self.near_cost * ((use - self.near) / (1.0 - self.near)) ** 2
        self._largest = max(self._largest, use)
        cost = math.exp(self._log_cost)
        self._costs[self._step] = cost
        over = self._step == self.steps
        info: dict[str, Any] = {"cost": cost, "use": use, "t_s": (at + self.lifted.r) / self.rate_hz}
        if broken or over:
            names = self.task.problem.targets.names
            info["limit"] = self._which(piece) if broken else ""
            info["errors"] = dict(zip(names, self._relative.tolist(), strict=True))
            info["largest_use"] = self._largest
        observation = self._observe()
        self._over = broken or over
        return observation, reward, broken, over and not broken, info

    def _level(self, action: Any) -> FloatArray:
        """Return the commands (m,), in amplitudes, that an action means."""
        if self.discrete:
            chosen = np.atleast_1d(np.asarray(action))
            inside = chosen.shape == self._now.shape and all(0 <= a <= len(LEVELS) and a == int(a) for a in chosen)
            if not inside:
                raise LimitError(f"an action must be 0 (hold) to {len(LEVELS)} per control, got {action}")
            return np.array([now if a == 0 else LEVELS[int(a) - 1] for a, now in zip(chosen, self._now, strict=True)])
        level = np.asarray(action, float)
        most = 1.0 + RATE_TOLERANCE
        if level.shape != self._now.shape or not all(-most <= a <= most for a in level.tolist()):
            raise LimitError(f"an action must hold {self._now.size} numbers from -1 to 1, got {action}")
        return level

    def _measure(self, start: int, stop: int) -> None:
        """Fill in what the sensors show of samples ``start`` to ``stop``."""
        error, source = self._drawn
        felt = self._seen[start:stop] if source is None else self._seen.take(source[start:stop])
        self._shown[start:stop] = self.display.show(felt + error[start:stop])

    def _observe(self) -> Observation:
        done = self.quiet + self._step * self.lifted.r
        self._left[0] = 1.0 - self._step / self.steps
        parts = (self._shown[done - self.stack : done].ravel(), self._now, self._left, 1.0 / (1.0 + self._relative))
        return np.concatenate(parts, dtype=np.float32, casting="same_kind")

    def _which(self, piece: Pieces) -> str:
        """Return the limit that was broken, in words."""
        return str(piece.ended[0]) or self.task.problem.prediction.names[int(np.nanargmax(piece.use[0]))]

    def episode(self) -> Episode:
        """Return the flight so far as the report draws it."""
        from testbench.envs.figures import Episode

        done, problem = self.quiet + self._step * self.lifted.r, self.task.problem
        theta, phi = self._flight.attitude()
        return Episode(
            title=f"{self.task.aircraft.name}, {self.task.scenario.condition.V_m_s:g} m/s",
            start_s=self.quiet / self.rate_hz,
            decision_s=self.decision_s,
            duration_s=self.samples / self.rate_hz,
            sensor_rate_hz=self.rate_hz,
            controls=problem.controls,
            u=self.commands,
            amplitude=self.amplitude,
            channels=tuple(s.channel for s in problem.experiment.sensors),
            y=self._shown[:done] * self.display.unit + self.display.centre,
            use=self._uses[: self._step].copy(),
            cost=self._costs[: self._step + 1].copy(),
            theta=theta,
            phi=phi,
            modes=dict(problem.bands.modes) if problem.bands else {},
        )

    def render(self) -> NDArray[np.uint8] | None:
        """Return the flight so far as an image (height, width, 3), or None without render mode."""
        if self.render_mode is None:
            return None
        from testbench.envs.figures import draw_episode

        return draw_episode(self.episode())


def _whole(ratio: float, what: str, of: str) -> int:
    whole = round(ratio)
    if whole < 1 or abs(ratio - whole) > RATE_TOLERANCE * max(ratio, 1.0):
        raise LimitError(f"{what} must be a whole number of samples {of} of the fastest sensors, got {ratio:g} of them")
    return whole


def _check(
    actions: str, dynamics: str, criterion: str, near: float, near_cost: float, breach_cost: float, mode: str | None
) -> None:
    faults = []
    for key, value, valid in (
        ("actions", actions, ("continuous", "discrete")),
        ("dynamics", dynamics, ("linear", "jsbsim")),
        ("criterion", criterion, ("D", "worst", "A", "E")),
        ("render_mode", mode, (None, "rgb_array")),
    ):
        if value not in valid:
            faults.append(f"{key} must be one of {', '.join(map(str, valid))}, got {value!r}")
    if not 0.0 < near < 1.0:
        faults.append(f"0 < near < 1 must hold for a share of a limit, got {near:g}")
    for key, number in (("near_cost", near_cost), ("breach_cost", breach_cost)):
        if not (math.isfinite(number) and number >= 0.0):
            faults.append(f"0 <= {key} must hold, got {number:g}")
    if faults:
        raise ScenarioError(faults)
