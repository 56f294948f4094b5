"""Copies of :class:`testbench.envs.excitation.ExcitationDesign` that fly together, all steps of all copies in arrays.

JSBSim's aircraft flies as a batch: one call of machine code for the frames of a decision. Each copy is the single
environment of its own seed: same observations, rewards and ends to 1e-9 of their range.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, SyncVectorEnv, VectorEnv
from gymnasium.vector.utils import batch_space

from testbench.core.errors import LimitError, ScenarioError
from testbench.core.record import FloatArray
from testbench.envs.dynamics import BatchFlights, LinearFlights, Mask, Pieces, why_alone
from testbench.envs.excitation import LEVELS, RATE_TOLERANCE, ExcitationDesign, Observation
from testbench.envs.tasks import Task
from testbench.flight.batch.check import judged

Stepped = tuple[Observation, npt.NDArray[Any], npt.NDArray[Any], npt.NDArray[Any], dict[str, Any]]


def make(num_envs: int = 1, **arguments: Any) -> VectorEnv[Observation, Any, npt.NDArray[Any]]:
    """Return ``num_envs`` copies that fly together, or one after the other where they cannot, which a warning says.

    Args:
        num_envs: how many.
        arguments: of :class:`ExcitationDesigns`.
    """
    mode = AutoresetMode(arguments.pop("autoreset_mode", AutoresetMode.NEXT_STEP))
    one = ExcitationDesign(**arguments)
    reason = "" if one.render_mode is None else "they draw pictures"
    if one.dynamics == "jsbsim" and not reason:
        reason = judged(one.task.aircraft, one.task.trimmed).reason or why_alone(one.task.problem.experiment.sensors)
    if reason:
        name = one.task.aircraft.name
        warnings.warn(f"{num_envs} copies of {name} fly one after the other: {reason}.", stacklevel=2)
        return SyncVectorEnv([lambda: ExcitationDesign(**arguments)] * num_envs, autoreset_mode=mode)
    return ExcitationDesigns(num_envs, autoreset_mode=mode, **arguments)


class ExcitationDesigns(VectorEnv[Observation, Any, npt.NDArray[Any]]):
    """Copies of the environment ``testbench/ExcitationDesign-v0`` that fly together.

    Spaces, rewards, ends and infos are those of ``gymnasium.vector.SyncVectorEnv`` over as many single environments,
    and so are seeds: copy i has ``seed + i``, or the i-th of a sequence. ``reset`` knows the option "reset_mask".

    Args:
        num_envs: how many copies; each 64 of them are one block of the batch.
        autoreset_mode: when a copy begins again that has ended. NEXT_STEP, the default: in the next step, whose action
            for it counts for nothing and whose reward is 0. SAME_STEP: at once, with "final_obs" and "final_info" in
            the infos. DISABLED: when it is reset.
        arguments: of :class:`testbench.envs.excitation.ExcitationDesign`; no render mode.

    Raises:
        ScenarioError: an unknown task or option.
        LimitError: fewer than one copy, or an aircraft that is not found equal to JSBSim in a batch.
    """

    def __init__(
        self, num_envs: int = 1, autoreset_mode: str | AutoresetMode = AutoresetMode.NEXT_STEP, **arguments: Any
    ) -> None:
        if num_envs < 1:
            raise LimitError(f"num_envs must be at least 1, got {num_envs}")
        one = ExcitationDesign(**arguments)
        if one.render_mode is not None:
            raise ScenarioError(f"render_mode must be None for copies that fly together, got {one.render_mode!r}")
        self._one, self.num_envs = one, num_envs
        self._mode = AutoresetMode(autoreset_mode)
        self.metadata = {**one.metadata, "autoreset_mode": self._mode}
        self.single_observation_space, self.single_action_space = one.observation_space, one.action_space
        self.observation_space = batch_space(one.observation_space, num_envs)
        self.action_space = batch_space(one.action_space, num_envs)
        self._flights = (
            LinearFlights(one.task, one.lifted, num_envs)
            if one.dynamics == "linear"
            else BatchFlights(one.task, one.lifted, num_envs)
        )
        self._gains = one.gain.of(num_envs)
        n, m, p, t = num_envs, len(one.amplitude), one.lifted.p, len(one.task.problem.targets.names)
        self._m, self._p = m, p
        self._generators: list[np.random.Generator | None] = [None] * n
        self._seen = np.empty((n, one.samples, p))
        self._error = np.empty((n, one.samples, p))
        self._source = np.empty((n, one.samples, p), np.int64)
        self._quiet_seen = self._flights.start(one.quiet)
        self._window = np.empty((n, one.stack, p))
        self._observed = np.empty((n, one.stack * p + m + 1 + t), np.float32)
        self._steps, self._over = np.zeros(n, np.int64), np.ones(n, bool)
        self._begun = np.zeros(n, bool)
        self._now, self._log_cost, self._relative = np.zeros((n, m)), np.zeros(n), np.ones((n, t))
        self._largest = np.zeros(n)
        self._rows, self._offsets = np.arange(n)[:, None], np.arange(one.lifted.r)

    @property
    def information(self) -> FloatArray:
        """(num_envs, k, k) Fisher information of each flight so far about the parameters that are estimated."""
        return self._gains.information

    @property
    def task(self) -> Task:
        """The task that all fly, see :class:`testbench.envs.tasks.Task`."""
        return self._one.task

    @property
    def amplitude(self) -> FloatArray:
        """(m,) command either side of trim, rad (1 for the throttle), that a full action means."""
        return self._one.amplitude

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin flights at trim, all of them or those of the option "reset_mask" (num_envs,).

        Raises:
            ScenarioError: another option, or a mask that is none.
            LimitError: as many seeds as copies are needed.
        """
        options = dict(options or {})
        which = np.asarray(options.pop("reset_mask", np.ones(self.num_envs, bool)))
        if options:
            raise ScenarioError(f"reset takes no options but reset_mask, got {', '.join(options)}")
        if which.shape != (self.num_envs,) or which.dtype != bool or not which.any():
            raise ScenarioError(f"reset_mask must be {self.num_envs} truth values, at least one true, got {which}")
        seeds: list[int | None] = [None] * self.num_envs
        if isinstance(seed, Sequence):
            seeds = list(seed)
        elif seed is not None:
            seeds = [seed + i for i in range(self.num_envs)]
        if len(seeds) != self.num_envs:
            raise LimitError(f"as many seeds as copies are needed, {self.num_envs}, got {len(seeds)}")
        for i in np.flatnonzero(which):
            if seeds[i] is not None or self._generators[i] is None:
                self._generators[i] = seeding.np_random(seeds[i])[0]
        self._begin(which)
        self._over[which] = False
        info: dict[str, Any] = {}
        for key, values in (("cost", np.exp(self._log_cost)), ("use", np.zeros(self.num_envs)), ("t_s", self._t_s())):
            info[key], info[f"_{key}"] = np.where(which, values, 0.0), which.copy()
        return self._observe(), info

    def step(self, actions: Any) -> Stepped:
        """Hold the commands of ``actions`` (num_envs, m), or (num_envs,) discrete ones, for one decision.

        Raises:
            LimitError: an action outside its space, or a flight that has not begun or, without autoreset, has ended.
        """
        one = self._one
        fresh = self._over.copy()
        if not self._begun.all() or (fresh.any() and self._mode is not AutoresetMode.NEXT_STEP):
            raise LimitError("all flights must have begun and not ended when a step is taken; call reset()")
        go = ~fresh
        self._now = self._levels(actions, go)
        piece = self._flights.fly(self._now * one.amplitude)
        at = one.quiet + np.where(go, self._steps, 0) * one.lifted.r
        self._measure(piece.seen, at)
        self._steps += go
        use = piece.use.max(axis=1)
        ended = piece.ended != ""
        broken = (ended | ~(use <= 1.0)) & go
        counts = go & ~broken
        self._gains.add(piece.sensitivities, at, counts, one.lifted.r)
        known = self._gains.known
        near = np.maximum(use - one.near, 0.0) / (1.0 - one.near)
        gained = self._log_cost - known.log_cost - one.near_cost * near**2
        rewards = np.where(counts, gained, np.where(broken, -one.breach_cost, 0.0))
        self._log_cost, self._relative = known
        self._largest = np.maximum(self._largest, use)
        truncated = counts & (self._steps == one.steps)
        self._over = broken | truncated
        if fresh.any():
            self._begin(fresh)
            use = np.where(fresh, 0.0, use)
        info = self._told(use)
        if self._over.any():
            self._tell_ends(info, piece, broken)
            if self._mode is AutoresetMode.SAME_STEP:
                info = self._begun_again(info)
        return self._observe(), rewards, broken, truncated, info

    def _begun_again(self, info: dict[str, Any]) -> dict[str, Any]:
        """Begin again what has ended; return the infos, with the last observations and infos of those flights."""
        over, final = self._over, np.full(self.num_envs, None, object)
        last = self._observe()
        for i in np.flatnonzero(over):
            final[i] = last[i].copy()
        self._begin(over)
        self._over = np.zeros(self.num_envs, bool)
        out = self._told(np.where(over, 0.0, info["use"]))
        ends: dict[str, Any] = {}
        for key in [k for k in info if not k.startswith("_")]:
            value = info[key]
            ends[key] = value if isinstance(value, dict) or value.dtype == object else np.where(over, value, 0.0)
            ends[f"_{key}"] = over.copy()
        return out | {"final_obs": final, "_final_obs": over.copy(), "final_info": ends, "_final_info": over.copy()}

    def _told(self, use: FloatArray) -> dict[str, Any]:
        info: dict[str, Any] = {"cost": np.exp(self._log_cost), "use": use, "t_s": self._t_s()}
        return info | {f"_{key}": np.ones(self.num_envs, bool) for key in info}

    def _tell_ends(self, info: dict[str, Any], piece: Pieces, broken: Mask) -> None:
        over, names = self._over, self._one.task.problem.prediction.names
        limit = np.full(self.num_envs, None, object)
        for i in np.flatnonzero(over):
            limit[i] = (piece.ended[i] or names[int(np.nanargmax(piece.use[i]))]) if broken[i] else ""
        targets = self._one.task.problem.targets.names
        errors: dict[str, Any] = {name: np.where(over, self._relative[:, i], 0.0) for i, name in enumerate(targets)}
        errors |= {f"_{name}": over.copy() for name in targets}
        info |= {"limit": limit, "errors": errors, "largest_use": np.where(over, self._largest, 0.0)}
        info |= {f"_{key}": over.copy() for key in ("limit", "errors", "largest_use")}

    def _t_s(self) -> FloatArray:
        return (self._one.quiet + self._steps * self._one.lifted.r) / self._one.rate_hz

    def _begin(self, which: Mask) -> None:
        """Put the flights ``which`` to the first decision."""
        one, quiet = self._one, self._one.quiet
        self._flights.reset(which)
        for i in np.flatnonzero(which):
            generator = self._generators[i]
            assert generator is not None
            drawn = one.display.draw(int(generator.integers(2**31)))
            self._error[i] = drawn.error
            if drawn.source is not None:
                self._source[i] = drawn.source
            first = slice(quiet - one.stack, quiet)
            self._seen[i, :quiet] = self._quiet_seen
            felt = self._quiet_seen if drawn.source is None else self._seen[i].take(drawn.source[:quiet])
            self._window[i] = one.display.show(felt[first] + drawn.error[first])
        self._gains.reset(which, quiet)
        self._log_cost, self._relative = self._gains.known
        self._steps[which], self._now[which], self._largest[which] = 0, 0.0, 0.0
        self._begun |= which

    def _measure(self, seen: FloatArray, at: npt.NDArray[np.int64]) -> None:
        """Take in what the sensors feel (n, r, p) from samples ``at`` (n,) on, and show it."""
        columns = at[:, None] + self._offsets
        self._seen[self._rows, columns] = seen
        if self._one.display.held:
            source = self._source[self._rows, columns]
            seen = self._seen.reshape(self.num_envs, -1)[self._rows[:, :, None], source]
        new = self._one.display.show(seen + self._error[self._rows, columns])
        self._window = np.concatenate([self._window, new], axis=1)[:, -self._one.stack :]

    def _observe(self) -> Observation:
        n, out, size = self.num_envs, self._observed, self._window[0].size
        out[:, :size] = self._window.reshape(n, size)
        out[:, size : size + self._m] = self._now
        out[:, size + self._m] = 1.0 - self._steps / self._one.steps
        out[:, size + self._m + 1 :] = 1.0 / (1.0 + self._relative)
        return out.copy()

    def _levels(self, actions: Any, go: Mask) -> FloatArray:
        """Return the commands (n, m), in amplitudes, that actions mean; 0 for flights that begin again."""
        given = np.asarray(actions)
        if self._one.discrete and given.ndim == 1:
            given = given[:, None]
        if given.shape != self._now.shape:
            raise LimitError(f"actions must have the shape {self.action_space.shape}, got {np.shape(actions)}")
        given = np.where(go[:, None], given, 0)
        if self._one.discrete:
            chosen = given.astype(np.int64)
            if not ((chosen >= 0) & (chosen <= len(LEVELS)) & (chosen == given)).all():
                raise LimitError(f"an action must be 0 (hold) to {len(LEVELS)} per control, got {actions}")
            return np.where(chosen == 0, self._now * go[:, None], np.array([0.0, *LEVELS])[chosen])
        if not (np.abs(given) <= 1.0 + RATE_TOLERANCE).all():
            raise LimitError(f"an action must hold {self._m} numbers from -1 to 1, got {actions}")
        return given.astype(float)
