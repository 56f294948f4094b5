"""What an autopilot puts out, as commands of the aircraft: by the autopilot's own settings, or as is usual.

Which output drives what, its ends, its centre and its direction stand in the parameter file that the autopilot flies
with (SERVOn_FUNCTION of ArduPilot, PWM_MAIN_FUNCn and CA_SV_CSn of PX4): it is read as a log's settings are, elevons
and V-tails included, so that what is simulated and what is later read of the log agree.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from testbench.aircraft import Aircraft
from testbench.core.door import read_text
from testbench.core.errors import RecordError
from testbench.logs import ardupilot, px4
from testbench.logs.signals import Log, Rule

Settings = Mapping[str, float]
_SETTING = re.compile(r"^(?:\d+\s+\d+\s+)?([A-Z][A-Z0-9_]+)[\s,=]+([-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?)", re.MULTILINE)
_PX4_USUAL: Settings = {
    **{"CA_SV_CS_COUNT": 4, "CA_SV_CS0_TYPE": 1, "CA_SV_CS1_TYPE": 2, "CA_SV_CS2_TYPE": 3, "CA_SV_CS3_TYPE": 4},
    **{
        "PWM_MAIN_FUNC3": 204,
        "PWM_MAIN_FUNC5": 101,
        "PWM_MAIN_FUNC6": 201,
        "PWM_MAIN_FUNC7": 202,
        "PWM_MAIN_FUNC8": 203,
    },
}
"""Of the planes that PX4 brings for simulators: ailerons left and right, elevator, rudder; the motor."""
_MOTORS, _SERVO_1 = range(101, 113), 201
_MOST = 1e9  # of a setting


def read_settings(path: Path) -> dict[str, float]:
    """Return the settings of a parameter file: name and value in a line, as ArduPilot and ground stations write them.

    Raises:
        RecordError: it cannot be read, or holds none.
    """
    text = read_text(path, "parameters", errors="replace")
    found = {name: float(value) for name, value in _SETTING.findall(text) if abs(float(value)) < _MOST}
    if not found:
        raise RecordError(
            f"a parameter file must hold lines of a name and a number, as SERVO1_FUNCTION 4, got '{path}'"
        )
    return found


class Outputs:
    """The commands that outputs of an autopilot mean.

    Args:
        aircraft: whose controls are commanded.
        autopilot: "ardupilot", whose outputs are pulses in microseconds, or "px4", whose are parts of full throw.
        settings: of the autopilot; as is usual if there are none.
        throw_rad: surface -> deflection at full command, rad; negative where full command moves it the other way. The
            aircraft's own if not given.

    Attributes:
        said: control -> where its command comes from, in words.

    Raises:
        RecordError: no control is driven by them.
    """

    def __init__(self, aircraft: Aircraft, autopilot: str, settings: Settings, throw_rad: Mapping[str, float]) -> None:
        rules = _px4_rules(settings or _PX4_USUAL) if autopilot == "px4" else _ardupilot_rules(settings)
        self.said: dict[str, str] = {}
        self._take: dict[str, tuple[Sequence[int], Callable[..., np.ndarray], float, float, float]] = {}
        for rule in rules:
            name, at = rule.channel.removesuffix("_cmd"), [int(re.sub(r"\D", "", f)) - 1 for f in rule.fields]
            if name in aircraft.controls and name not in self._take:
                control = aircraft.controls[name]
                self._take[name] = at, rule.convert, throw_rad.get(name, control.full), control.low, control.full
                self.said[name] = f"{rule.said}; {rule.assumed}" if rule.assumed else rule.said
        if not self._take:
            raise RecordError(
                f"the settings must drive one of {', '.join(aircraft.controls)} of {aircraft.name}, got none"
            )

    def commands(self, outputs: Sequence[float]) -> dict[str, float]:
        """Return control -> command, SI, within its range; without those whose output is off."""
        out = {}
        for name, (at, convert, throw, low, full) in self._take.items():
            given = [np.array([outputs[i]], float) if i < len(outputs) else np.full(1, np.nan) for i in at]
            with np.errstate(invalid="ignore"):
                value = throw * float(convert(*given)[0])
            if np.isfinite(value):
                out[name] = min(max(value, low), full)
        return out


def _log(settings: Settings) -> Log:
    return Log(Path("settings"), "settings", {}, parameters=settings)


def _ardupilot_rules(settings: Settings) -> list[Rule]:
    log = _log(settings)
    return [*ardupilot.servo_rules(log, named=True), *ardupilot.servo_rules(log, named=False)]


def _px4_rules(settings: Settings) -> list[Rule]:
    """Return the rules of PX4's servos as those of its outputs; a reversed output is turned back."""
    function = {int(settings.get(f"PWM_MAIN_FUNC{n}", 0)): n for n in range(16, 0, -1)}
    turned = int(settings.get("PWM_MAIN_REV", 0))
    rules = []
    for rule in px4.servo_rules(_log(settings)):
        servos = [_SERVO_1 + int(re.sub(r"\D", "", f)) for f in rule.fields]
        if all(s in function for s in servos):
            at = [function[s] for s in servos]
            signs = [-1.0 if turned >> (n - 1) & 1 else 1.0 for n in at]

            def convert(*x: np.ndarray, of: Rule = rule, signs: Sequence[float] = signs) -> np.ndarray:
                return of.convert(*(s * each for s, each in zip(signs, x, strict=True)))

            rules.append(Rule(rule.channel, "", tuple(map(str, at)), convert, f"outputs {at}: {rule.said}"))
    motors = [n for of, n in sorted(function.items()) if of in _MOTORS]
    if motors:
        rules.append(
            Rule("thr_cmd", "", tuple(map(str, motors)), lambda *x: np.mean(x, axis=0), f"outputs {motors}: the motors")
        )
    return rules
