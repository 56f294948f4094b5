"""What a hidden truth changes: commands on their way to the servos, the JSBSim model, and what sensors read.

The edits of a model that truths are made of, terms of the aerodynamics and states, are here, too.

Shares no code with the library of effects; neither imports the other (tests/test_house_rules.py).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from testbench.aircraft import Aircraft, Amendment, Insert, ScaleCoefficient, SetProperty
from testbench.aircraft.amend import Change
from testbench.aircraft.seams import with_servo
from testbench.core.record import FlightRecord, FloatArray
from testbench.flight import load_aircraft
from testbench.flight.air import Gust
from testbench.questions import hidden
from testbench.sensors import Sensor, SensorSuite

Size = Mapping[str, float]
Law = Callable[[FloatArray, float], FloatArray]
"""(command (frames,) as deviation from trim, frame time) -> what is sent on."""


@dataclass(frozen=True)
class Truth:
    """What a hidden truth changes, in the order in which it acts.

    Attributes:
        elevator, throttle: what becomes of the command on its way to the servo.
        surfaces: the same for other controls, by name ("da", "dr").
        whole_servo: the elevator's command is turned into the deflection itself; of the believed servo only its slew
            limit is left.
        changes: edits of the JSBSim model.
        fed_back: True if one of them moves a surface beside its command.
        flexible: fly with the elastic modes.
        extra_kg: mass that the edits add.
        read: what becomes of each sensor.
        spoil: (channel, readings, time) -> readings, after the sensors.
        gust: a gust, met in one of the manoeuvres.
        factors: coefficient -> what the true one is times the believed one.
        later: time after take-off, s -> what else has changed by then.
    """

    elevator: Law | None = None
    throttle: Law | None = None
    surfaces: Mapping[str, Law] = field(default_factory=dict)
    whole_servo: bool = False
    changes: tuple[Change, ...] = ()
    fed_back: bool = False
    flexible: bool = False
    extra_kg: float = 0.0
    read: Callable[[Sensor], Sensor] | None = None
    spoil: Callable[[str, FloatArray, FloatArray], FloatArray] | None = None
    gust: Gust | None = None
    factors: Mapping[str, float] = field(default_factory=dict)
    later: Callable[[float], Truth] | None = None

    def with_(self, other: Truth) -> Truth:
        """Return both truths at once; command and sensor parts must not clash."""
        return Truth(
            elevator=self.elevator or other.elevator,
            throttle=self.throttle or other.throttle,
            surfaces={**self.surfaces, **other.surfaces},
            whole_servo=self.whole_servo or other.whole_servo,
            changes=(*self.changes, *other.changes),
            fed_back=self.fed_back or other.fed_back,
            flexible=self.flexible or other.flexible,
            extra_kg=self.extra_kg + other.extra_kg,
            read=self.read or other.read,
            spoil=self.spoil or other.spoil,
            gust=self.gust or other.gust,
            factors={**self.factors, **other.factors},
            later=self.later or other.later,
        )

    def real(self, aircraft: str, as_issued: bool = True) -> hidden.Real:
        """Return what flies where an aircraft of that name is believed, its wings held rigid.

        Commands are recorded as they were issued, or else as they reached the servos.
        """

        def there(at_s: float) -> Truth:
            return self if self.later is None else self.with_(self.later(at_s))

        def amend(believed: Aircraft, suite: SensorSuite, at_s: float) -> tuple[Aircraft, SensorSuite]:
            truth = there(at_s)
            return truth.aircraft(believed), truth.sensors(suite)

        def send(controls: Sequence[str], u: FloatArray, dt_s: float, at_s: float) -> FloatArray:
            return there(at_s).sent(controls, u, dt_s)

        made = hidden.Truth(amend, send if as_issued else None, None if self.spoil is None else self.spoiled)
        return hidden.Real(load_aircraft(aircraft, "flexible" if self.flexible else "rigid"), truth=made)

    def aircraft(self, believed: Aircraft) -> Aircraft:
        """Return what flies in place of a believed aircraft."""
        changes: list[Change] = [*self.changes, *(ScaleCoefficient(n, f) for n, f in self.factors.items())]
        if self.whole_servo:
            changes.append(SetProperty(_LAG, 1e5))  # its slew limit stays
        base = believed
        lags = [c for c in changes if isinstance(c, SetProperty) and c.name == _LAG]
        for change in lags if believed.adapter is not None else []:
            # a foreign model has no servo of that name: it gets one, or another corner frequency
            base, more = with_servo(base, "de", change.value)
            changes = [*(c for c in changes if c is not change), *more]
        real = base.amended(Amendment("hidden", "hidden", tuple(changes))) if changes else base
        return replace(real, mass=replace(real.mass, mass_kg=real.mass.mass_kg + self.extra_kg))

    def sensors(self, suite: SensorSuite) -> SensorSuite:
        """Return the sensors as they really read."""
        return suite if self.read is None else replace(suite, sensors=tuple(self.read(s) for s in suite.sensors))

    def sent(self, controls: Sequence[str], u: FloatArray, dt_s: float) -> FloatArray:
        """Return what reaches the servos of the commands ``u`` (frames, m)."""
        out = u.copy()
        for control, law in (("de", self.elevator), ("thr", self.throttle), *self.surfaces.items()):
            if law is not None and control in controls:
                column = list(controls).index(control)
                out[:, column] = law(u[:, column], dt_s)
        return out

    def spoiled(self, record: FlightRecord) -> FlightRecord:
        """Return the record with readings spoiled after the sensors."""
        data = record.data.copy()
        for i, name in enumerate(record.channels):
            if self.spoil is not None:
                data[:, i] = self.spoil(name, data[:, i], record.t_s)
        return replace(record, data=data)


_LAG = "fcs/elevator-lag-rad_sec"  # of the packaged aircraft


# --- edits of a model ------------------------------------------------------------------------------------------------

ALPHA, ELEVATOR, ALPHA_DOT = "aero/alpha-rad", "fcs/elevator-pos-rad", "aero/alphadot-rad_sec"
CHORD_TIME = "aero/ci2vel"  # cbar / (2 V)


def coefficient(axis: str, *terms: str) -> Insert:
    """Return the edit that adds qbar S (cbar for PITCH) times the product of ``terms`` (XML) to an axis."""
    arm = "<property>metrics/cbarw-ft</property>" if axis == "PITCH" else ""
    body = f"<property>aero/qbar-psf</property><property>metrics/Sw-sqft</property>{arm}{''.join(terms)}"
    name = f"hidden/{axis}-{len(body)}"
    return Insert(f"aerodynamics/axis[@name='{axis}']", f'<function name="{name}"><product>{body}</product></function>')


def term(tag: str, *parts: str) -> str:
    """Return the XML of a function term, e.g. ``term("sum", a, b)``."""
    return f"<{tag}>{''.join(parts)}</{tag}>"


def number(x: float) -> str:
    """Return the XML of a number."""
    return f"<value>{float(x)!r}</value>"


def prop(name: str) -> str:
    """Return the XML of a property."""
    return f"<property>{name}</property>"


def state(name: str, target: str, time_s: float) -> tuple[Insert, Insert]:
    """Return the edits of a state that follows ``target`` (XML): x+ = x + (target - x) (1 - exp(-dt / time))."""
    power = term("quotient", term("product", number(-1.0), prop("simulation/dt")), number(time_s))
    gain = term("difference", number(1.0), term("exp", power))
    step = term("sum", prop(name), term("product", gain, term("difference", target, prop(name))))
    rest = term("ifthen", term("gt", prop("simulation/dt"), number(0.0)), step, term("sum", target, number(0.0)))
    return (
        Insert("flight_control", f'<property value="0">{name}</property>', 0),
        Insert(
            "flight_control",
            f'<channel name="{name}-c"><fcs_function name="{name}-f"><function>{rest}</function>'
            f"<output>{name}</output></fcs_function></channel>",
        ),
    )
