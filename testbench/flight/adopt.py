"""Adopt a JSBSim model that somebody else wrote: start it, probe it, find where it trims, and return it as an Aircraft.

Nothing is typed by hand: controls, throws and signs come from :mod:`testbench.flight.probe`, mass and inertia from the
model as it flies, the range of speeds from trims. What was found and what was assumed comes with it, in sentences.
"""

from __future__ import annotations

import hashlib
import json
import math
import re
import sys
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache
from importlib.metadata import version

from testbench.aircraft import Aircraft, Control
from testbench.aircraft.adapter import THROTTLE, Adapter
from testbench.aircraft.model import Geometry, MassProperties
from testbench.aircraft.outline import sketch
from testbench.aircraft.source import Source
from testbench.core.atmosphere import air_density
from testbench.core.constants import FT_M, G0_M_S2, JSBSIM_LENGTH_M, LBF_N
from testbench.core.door import read_json
from testbench.core.errors import ModelError, Refusal, TrimError
from testbench.core.files import keep, kept_in, sources
from testbench.flight.condition import FlightCondition, TrimmedFlight
from testbench.flight.executive import Executive
from testbench.flight.limits import limits_of
from testbench.flight.mass import geometry_flown, mass_flown
from testbench.flight.probe import NO_SURFACES, Probe, probe, undefined
from testbench.flight.thrust import engine_words, thrust_N
from testbench.flight.trim import trim

RATE_HZ = 200.0
_LIFT = (0.5, 0.35, 0.7, 0.25, 0.9, 0.15)  # lift coefficients at which a trim is sought first, in this order
_SPEED_STEP = 1.08
_FASTER, _SLOWER = 2.2, 0.5  # of the design speed: no trim is sought beyond
_SMALL_SPAN_M, _LARGE_SPAN_M = 6.0, 20.0
_HEIGHT_M = {"small": 300.0, "middle": 1000.0, "large": 3000.0}
# What is set in every model that has it. The throttle is the user's; fuel does not burn, so that the mass stays.
_SETTINGS = {
    "gear/gear-cmd-norm": 0.0,
    "gear/gear-pos-norm": 0.0,
    "fcs/flap-cmd-norm": 0.0,
    "fcs/speedbrake-cmd-norm": 0.0,
    "fcs/spoiler-cmd-norm": 0.0,
    "propulsion/magneto_cmd": 3.0,
    "propulsion/cutoff_cmd": 0.0,
    "propulsion/fuel_freeze": 1.0,
}
_END = 0.002  # of a speed, to which the slowest level flight is known
_FEED_LBS = 5.0
_FAST_GLIDER_M_S = 60.0
_LEVERS, _SHORT = (1.0, 0.75, 0.5, 0.25, 0.0), 0.1  # of propellers; thrust of the weight below which they are tried
_THOROUGH = 2  # speeds at which damped steps from several starts are tried, when no quick trim succeeds
_LEVER = re.compile(r"/?controls/engines/engine(\[\d+\])?/throttle")
_FOLLOWED = 2.0  # frames that a propeller takes to change its speed, if made heavier for taking less than one
_FILTER_FRAMES = 60  # in which a filter between command and engine moves
_NO_THRUST, _ABSURD = 0.01, 20.0  # of the weight
_CLOSE, _CRUISE = 1.15, 1.3  # of the slowest speed: a design speed below the first becomes the second
_PER_ENGINE = {"fcs/mixture-cmd-norm": 1.0, "fcs/advance-cmd-norm": 1.0, "fcs/feather-cmd-norm": 0.0}
_BLADES, _INTEGRATES = re.compile(r"propulsion/engine\[\d+\]/blade-angle"), ("pid", "integrator")
_ROTORS = 3  # of a multirotor, at least
_NOT_FIXED_WING = (
    ("rotor", "a rotor: a helicopter or autogyro"),
    ("gas_cell", "cells of gas that carry it: an airship or balloon"),
)


@dataclass(frozen=True, eq=False)
class Adopted:
    """A foreign model as an aircraft of the testbench."""

    aircraft: Aircraft  # ready to be trimmed and flown
    trimmed: TrimmedFlight  # at the design condition
    found: tuple[str, ...]  # what was found, in sentences
    assumed: tuple[str, ...]  # what was assumed, in sentences
    engines: tuple[str, ...]  # what drives it, one line per engine
    tanks_kg: tuple[float, ...]  # fuel in every tank
    missing: tuple[str, ...]  # moments and products of inertia that the model does not give; they count as zero
    # slowest, fastest: speeds between which it trims, m/s
    slowest: float
    fastest: float
    ends: tuple[str, str]  # why it trims no slower and no faster


def adopt(source: Source, V_m_s: float | None = None, h_m: float | None = None) -> Adopted:
    """Return a model that somebody else wrote as an aircraft.

    Args:
        source: the model.
        V_m_s: design speed; where the wing has a lift coefficient of 0.5, or the nearest that trims, if not given.
        h_m: design altitude; 300, 1000 or 3000 m by its span if not given.

    Raises:
        ModelError: JSBSim refuses the model (its words are quoted), or it is no aircraft with wings and controls.
        TrimError: it trims nowhere.
    """
    source, governed = _governed(source)
    try:
        found = _adopted(source, V_m_s, h_m, 0.0)
        return replace(found, found=(*found.found, *governed))
    except TrimError as first:
        try:
            found = _adopted(source, V_m_s, h_m, 1.0)
            return replace(found, found=(*found.found, *governed))
        except (TrimError, ModelError):
            raise first from None


def _governed(source: Source) -> tuple[Source, list[str]]:
    """Return the model with JSBSim's governor where a system of its own integrates the blade angle by the speed.

    Such a system stands still while time does, with the blades at their fine stop: the model trims nowhere, or with a
    thrust that it never flies with. At rest both keep the speed that the lever asks for, or the blades at a stop. A
    switch that chooses between angles, or an angle that nothing governs, stays.
    """
    tree = ET.fromstring(source.xml)
    own = [
        (part, output)
        for channel in tree.iter("channel")
        if "propeller-rpm" in "".join(channel.itertext())
        for part in channel
        if part.tag in _INTEGRATES
        for output in part.findall("output")
        if _BLADES.fullmatch((output.text or "").strip())
    ]
    files = dict(source.engine_files)
    for name, text in source.engine_files.items():
        root = ET.fromstring(text)
        stops = [_value(root, tag) for tag in ("minpitch", "maxpitch", "minrpm", "maxrpm")]
        if own and root.tag == "propeller" and stops[0] < stops[1] and 0.0 < stops[2] < stops[3]:
            switch = root.find("constspeed")
            switch = ET.SubElement(root, "constspeed") if switch is None else switch
            switch.text = "1"
            files[name] = ET.tostring(root, encoding="unicode")
    if files == source.engine_files:
        return source, []
    for part, output in own:
        part.remove(output)
    said = (
        "propellers: a system of the model's own turns the blades by the speed, which it does not while time stands "
        "still; JSBSim's governor, between the speeds and stops of the propeller's file, takes its place"
    )
    return replace(source, xml=ET.tostring(tree, encoding="unicode"), engine_files=files), [said]


def _value(root: ET.Element, tag: str) -> float:
    try:
        return float(root.findtext(tag) or 0.0)
    except ValueError:
        return 0.0


def _adopted(source: Source, V_m_s: float | None, h_m: float | None, declared: float) -> Adopted:
    """Return the aircraft with ``declared`` for what the model reads and nothing defines; tried anew only with any."""
    tree = ET.fromstring(source.xml)
    _check_wings(source)
    raw, fdm, fed = _started(source, tree, declared)
    assert raw.adapter is not None
    neutral, engines = raw.adapter.neutral, fdm.fdm.get_propulsion().get_num_engines()
    height = h_m if h_m is not None else _HEIGHT_M[_size(raw.geometry.b_m)]
    speeds = [V_m_s] if V_m_s is not None else [_speed(raw, height, CL) for CL in _LIFT]
    probed = _probed(source, raw, engines, FlightCondition(speeds[0], height))
    _check_propellers(tree, source)
    throttles, said = _throttles(raw, neutral, engines, FlightCondition(speeds[0], height))
    aircraft, heavier = _with_inertia(_controlled(raw, probed, throttles), tree, FlightCondition(speeds[0], height))
    if not throttles and h_m is None and speeds[0] > _FAST_GLIDER_M_S:
        height = _HEIGHT_M["large"]  # it sinks by tens of metres per second
    aircraft, turned = _with_levers(aircraft, engines, FlightCondition(speeds[0], height))
    heights = [height, *(h for h in (_HEIGHT_M["middle"], _HEIGHT_M["small"]) if h < height and h_m is None)]
    first = _first_trim(aircraft, speeds, heights)
    height, design = first.condition.h_m, first.condition.V_m_s
    aircraft = replace(aircraft, design_V_m_s=design, design_h_m=height)
    slowest, fastest, ends = _range(aircraft, first)
    if V_m_s is None and design < _CLOSE * slowest:
        design = float(f"{min(_CRUISE * slowest, math.sqrt(slowest * fastest)):.3g}")
        aircraft = replace(aircraft, design_V_m_s=design)
    limits, sources = limits_of(aircraft, first, (slowest, fastest), ends)
    aircraft = replace(aircraft, limits=limits, limit_sources=sources, level_V_m_s=(slowest, fastest))
    missing = tuple(a for a in ("ixx", "iyy", "izz", "ixz") if tree.find(f"mass_balance/{a}") is None)
    found = [*probed.found, *_taken(source), *said, *turned]
    if height != heights[0]:
        found.append(f"it trims nowhere at {heights[0]:g} m: flown at {height:g} m")
    if not throttles:
        why = "no engine" if not engines else "no engine with thrust"
        found.append(f"{why}: it is trimmed over its flight-path angle, and flies descending")
    return Adopted(
        aircraft,
        trim(aircraft, FlightCondition(design, height), near=first),
        tuple(found),
        (*probed.assumed, *heavier, *_assumed(neutral, declared, missing, fed)),
        tuple(engine_words(fdm, i) for i in range(engines)),
        tuple(_tanks(fdm)),
        missing,
        slowest,
        fastest,
        ends,
    )


def _check_wings(source: Source) -> None:
    """Raise ModelError if something else than wings carries the model."""
    for text in (source.xml, *source.engine_files.values()):
        for tag, words in _NOT_FIXED_WING:
            if f"<{tag} " in text or f"<{tag}>" in text:
                raise ModelError(
                    f"an aircraft must be flown by wings and control surfaces, but {source.name} has {words}"
                )
    tree = ET.fromstring(source.xml)
    if not all(_positive(tree.findtext(f"metrics/{name}")) for name in ("wingarea", "chord")):
        _check_rotors(source)


def _positive(text: str | None) -> bool:
    try:
        return text is None or float(text) > 0.0
    except ValueError:
        return True  # said where the number is read


def _check_rotors(source: Source) -> None:
    """Raise ModelError if propellers carry a model that has no wing or no surface to steer it by."""
    tree, propellers = ET.fromstring(source.xml), 0
    for thruster in tree.findall("propulsion/engine/thruster"):
        text = source.engine_files.get(f"{thruster.get('file')}.xml", "")
        propellers += "<propeller" in text or thruster.find("propeller") is not None
    forces = len(tree.findall("external_reactions/force"))
    count, what = max((propellers, "propellers"), (forces, "forces from outside"))
    if count >= _ROTORS:
        raise ModelError(
            f"an aircraft must be flown by wings and control surfaces, but {source.name} is a multirotor: "
            f"{count} {what} carry and steer it"
        )


def _started(source: Source, tree: ET.Element, declared: float) -> tuple[Aircraft, Executive, list[int]]:
    """Return the model without controls, ready to be started; an executive of it; and the empty tanks that it fills."""
    raw = Aircraft(
        source.name,
        _title(tree, source.name),
        Geometry(1.0, 1.0, 1.0),
        MassProperties(1.0, 1.0, 1.0, 1.0, 0.0),
        {},
        {},
        RATE_HZ,
        50.0,
        1000.0,
        source.xml,
        source.engine_files,
        adapter=Adapter(),
        outline=sketch(tree),
    )
    somewhere = FlightCondition(50.0, 1000.0)
    neutral = undefined(raw, somewhere)
    if declared:
        levers = [n for n in neutral if not _LEVER.fullmatch(n)]
        if not levers:
            raise TrimError(f"{source.name} reads nothing that could be declared otherwise")
        neutral = {n: declared if n in levers else 0.0 for n in neutral}
    raw = replace(raw, adapter=Adapter(neutral=neutral))
    fdm = Executive(raw, RATE_HZ, somewhere)
    engines = fdm.fdm.get_propulsion().get_num_engines()
    settings = {n: v for n, v in _SETTINGS.items() if fdm.has(n)}
    settings |= {f"{n}[{i}]": v for i in range(engines) for n, v in _PER_ENGINE.items() if fdm.has(f"{n}[{i}]")}
    fed = _empty_feeds(fdm, tree)
    settings |= {f"propulsion/tank[{i}]/contents-lbs": _FEED_LBS for i in fed}
    adapter = Adapter(settings=settings, neutral=neutral)
    geometry, mass = geometry_flown(fdm, source.path), mass_flown(fdm, source.path)
    return replace(raw, adapter=adapter, geometry=geometry, mass=mass), fdm, fed


def _probed(source: Source, raw: Aircraft, engines: int, condition: FlightCondition) -> Probe:
    """Probe the controls; the error of a model without surfaces says by what it is steered."""
    try:
        return probe(raw, condition, 0.05)
    except ModelError as error:
        if str(error).startswith(NO_SURFACES):
            _check_rotors(source)
        number = f"{engines} engine{'s' if engines != 1 else ''}" if engines else "nothing at all"
        steered = f"; it is steered by {number}" if str(error).startswith(NO_SURFACES) else ""
        raise ModelError(f"{error}{steered}") from error


def _taken(source: Source) -> list[str]:
    """Return what was put into the model and what was left out, in sentences."""
    out = list(source.repaired)
    if source.left_out:
        out.append(f"left out: {', '.join(source.left_out)} (a flight is recorded by the testbench)")
    if source.included:
        out.append(f"included files that were put into it: {', '.join(source.included)}")
    return out


def _assumed(neutral: Mapping[str, float], declared: float, missing: Sequence[str], fed: Sequence[int]) -> list[str]:
    """Return what was assumed of the model, in sentences."""
    out = []
    if neutral:
        out.append(f"the model reads {', '.join(neutral)}, which nothing in it defines: declared as {declared:g}")
    if missing:
        out.append(f"the model gives no {', '.join(missing)}: zero, as JSBSim takes it")
    if fed:
        out.append(
            f"the tanks that feed engines are empty in the file ({', '.join(map(str, fed))}): {_FEED_LBS:g} lb each"
        )
    return [*out, "limits of attitude and height, as no model states them"]


def _with_inertia(aircraft: Aircraft, tree: ET.Element, condition: FlightCondition) -> tuple[Aircraft, list[str]]:
    """Return the aircraft with propellers that frames can follow, and which of them were made heavier for that.

    The least time constant of a speed is at full throttle. A frame longer than twice of it would throw the speed from
    one side of its equilibrium to the other, further every time. No trim depends on the inertia.
    """
    if "thr" not in aircraft.controls:
        return aircraft, []
    fdm = Executive(aircraft, RATE_HZ, condition)
    fdm.command({"thr": 1.0})
    fdm.place_at(condition)
    fdm.evaluate()
    files, said = dict(aircraft.engine_files), []
    elements = tree.findall("propulsion/engine")
    for engine, (inertia, rate) in fdm.propellers.quickness().items():
        thruster = elements[engine].find("thruster")
        name = "" if thruster is None else f"{thruster.get('file')}.xml"
        heavier = inertia * rate * _FOLLOWED / RATE_HZ
        if heavier < _FOLLOWED * inertia or files.get(name, "") != aircraft.engine_files.get(name):
            continue
        root = ET.fromstring(files[name])
        ixx = root.find("ixx")
        if ixx is None:
            continue
        given = f"{ixx.text} {ixx.get('unit', 'SLUG*FT2')}"
        ixx.text = f"{heavier:.3g}"
        ixx.set("unit", "KG*M2")
        files[name] = ET.tostring(root, encoding="unicode")
        said.append(
            f"propeller {name}: its inertia ({' '.join(given.split())} in the file, {inertia:.2g} kg m2 in JSBSim) "
            f"lets its speed change within {1e3 / rate:.2g} ms, which frames of {1e3 / RATE_HZ:g} ms cannot follow: "
            f"flown with {heavier:.2g} kg m2; no trim depends on it"
        )
    return replace(aircraft, engine_files=files), said


def _with_levers(aircraft: Aircraft, engines: int, condition: FlightCondition) -> tuple[Aircraft, list[str]]:
    """Return the aircraft with its propeller levers where they give thrust, and what was found."""
    lever, adapter = _lever(aircraft, engines, condition), aircraft.adapter
    if lever == 1.0 or adapter is None:
        return aircraft, []
    turned = {f"fcs/advance-cmd-norm[{i}]": lever for i in range(engines)}
    said = f"propellers: at full speed they give little thrust; the lever is set to {100.0 * lever:g} %"
    return replace(aircraft, adapter=replace(adapter, settings={**adapter.settings, **turned})), [said]


def _check_propellers(tree: ET.Element, source: Source) -> None:
    """Raise ModelError if a propeller is larger than the aircraft: a diameter without a unit is taken in feet."""
    span = tree.find("metrics/wingspan")
    if span is None or span.text is None:
        return
    b = float(span.text) * JSBSIM_LENGTH_M.get(span.get("unit", "FT").upper(), FT_M)
    for name, text in source.engine_files.items():
        root = ET.fromstring(text)
        diameter = root.find("diameter") if root.tag == "propeller" else None
        if diameter is None or diameter.text is None:
            continue
        unit = diameter.get("unit")
        D = float(diameter.text) * JSBSIM_LENGTH_M.get((unit or "FT").upper(), FT_M)
        if b < D:
            raise ModelError(
                f"a propeller must be smaller than the span of {b:.3g} m, but the one of {name} measures {D:.3g} m: "
                f"<diameter> {diameter.text.strip()} has {'no unit and counts as feet' if unit is None else unit}"
            )


def _title(tree: ET.Element, name: str) -> str:
    """Return the model's name and the first sentence of its description."""
    said = " ".join((tree.findtext("fileheader/description") or "").split())
    first = re.split(r"(?<=[a-z0-9)])\. ", said)[0].strip().rstrip(".")
    first = re.sub(r"^Models an? ", "", first)
    return f"{name}: {first[:100]}" if first else name


def _size(b_m: float) -> str:
    return "small" if b_m < _SMALL_SPAN_M else "middle" if b_m < _LARGE_SPAN_M else "large"


def _speed(aircraft: Aircraft, h_m: float, CL: float) -> float:
    """Return the speed of level flight at a lift coefficient, m/s, rounded as people would."""
    V = math.sqrt(2.0 * aircraft.mass.mass_kg * G0_M_S2 / (air_density(h_m) * aircraft.geometry.S_m2 * CL))
    return float(f"{V:.2g}")


def _controlled(raw: Aircraft, probed: Probe, throttles: tuple[str, ...]) -> Aircraft:
    """Return the aircraft with the controls that were found."""
    assert raw.adapter is not None
    controls: dict[str, Control] = {}
    for link in probed.links:
        ends = [d for drive in link.drives for d, _ in drive.points]
        controls[link.control] = Control(link.control, link.command, max(ends), min(ends), 1.0)
    if throttles:
        controls["thr"] = Control("thr", THROTTLE, 1.0)
    return replace(raw, adapter=replace(raw.adapter, links=probed.links, throttles=throttles), controls=controls)


def _throttles(
    raw: Aircraft, neutral: Mapping[str, float], engines: int, condition: FlightCondition
) -> tuple[tuple[str, ...], list[str]]:
    """Return the throttles that engines follow, none if engines give no thrust, and what was found.

    A command that the model's own control system does not pass on is replaced by the position at the engine; levers of
    FlightGear that nothing in the model moves follow the same command.
    """
    if not engines:
        return (), []
    said = []
    levers = tuple(n for n in neutral if _LEVER.fullmatch(n))
    commands = tuple(f"fcs/throttle-cmd-norm[{i}]" for i in range(engines))
    positions = tuple(f"fcs/throttle-pos-norm[{i}]" for i in range(engines))
    chosen: tuple[str, ...] = commands
    thrusts = [0.0]
    for names in (commands, positions):
        chosen = (*names, *levers)
        assert raw.adapter is not None
        tried = replace(
            raw, adapter=replace(raw.adapter, throttles=chosen), controls={"thr": Control("thr", THROTTLE, 1.0)}
        )
        fdm = Executive(tried, RATE_HZ, condition)
        follows, thrusts, before = True, [], [-1.0]
        for throttle in (0.8, 1.0, 0.3):
            fdm.command({"thr": throttle})
            fdm.place_at(condition, 0.05)
            for _ in range(3):
                fdm.fdm.run_ic()
            at = [fdm.get(n) for n in positions]
            for _ in range(_FILTER_FRAMES):
                fdm.fdm.run_ic()
            later = [fdm.get(n) for n in positions]
            still = all(abs(a - b) < 1e-6 for a, b in zip(at, later, strict=True))
            follows = follows and still and at != before
            before = at
            fdm.evaluate()
            thrusts.append(thrust_N(fdm))
        if follows:
            break
    if chosen[0] == positions[0]:
        said.append("throttle: the model passes the command on late or not at all: the engines are commanded directly")
    if levers:
        said.append(f"throttle: {', '.join(levers)} follow it")
    most, weight = max(thrusts), raw.mass.mass_kg * G0_M_S2
    if most < _NO_THRUST * weight:
        said.append(
            f"engines: {most:.3g} N at full throttle for a weight of {weight:.3g} N ({fdm.engine_state()}): "
            "counted as none"
        )
        return (), said
    if most > _ABSURD * weight:
        said.append(f"engines: {most:.3g} N at full throttle for a weight of {weight:.3g} N")
    return chosen, said


def _declared(aircraft: Aircraft) -> str:
    """Return in words what a model reads that nothing defines: it may want another value to fly."""
    neutral = [n for n in (aircraft.adapter.neutral if aircraft.adapter else {}) if not _LEVER.fullmatch(n)]
    return f"; declared as 0, since nothing in the model defines them: {', '.join(neutral)}" if neutral else ""


def _lever(aircraft: Aircraft, engines: int, condition: FlightCondition) -> float:
    """Return the position of the propeller levers, 1 for full speed; less where thrust is short and that gives more."""
    thrusts: dict[float, float] = {}
    if "thr" not in aircraft.controls:
        return 1.0
    for lever in _LEVERS:
        fdm = Executive(aircraft, RATE_HZ, condition)
        names = [n for i in range(engines) if fdm.has(n := f"fcs/advance-cmd-norm[{i}]")]
        if not fdm.propellers.governed or not names:
            return 1.0
        for name in names:
            fdm.set(name, lever)
        fdm.command({"thr": 1.0})
        fdm.place_at(condition)
        fdm.evaluate()
        thrusts[lever] = fdm.get("forces/fbx-prop-lbs") * LBF_N
        if lever == 1.0 and thrusts[lever] > _SHORT * aircraft.mass.mass_kg * G0_M_S2:
            return 1.0
    return max(thrusts, key=lambda x: thrusts[x])


def _first_trim(aircraft: Aircraft, speeds: Sequence[float], heights: Sequence[float]) -> TrimmedFlight:
    reasons = []
    quick = [(V, h, False) for h in heights for V in (speeds if h == heights[0] else speeds[:3])]
    for V, h, thorough in (*quick, *((V, heights[0], True) for V in speeds[:_THOROUGH])):
        try:
            return trim(aircraft, FlightCondition(V, h), thorough=thorough)
        except TrimError as error:
            reasons += [error.message] if thorough else []
    raise TrimError(
        f"{aircraft.name} must trim somewhere, but none of {', '.join(f'{V:g}' for V in speeds)} m/s at "
        f"{' or '.join(f'{h:g}' for h in heights)} m does; the first: {reasons[0]}{_declared(aircraft)}; name a speed "
        "with --speed"
    )


_version = cache(version)


def _range(aircraft: Aircraft, first: TrimmedFlight) -> tuple[float, float, tuple[str, str]]:
    """Return what :func:`_sought` finds, from disk if it was found before: a piston engine takes seconds."""
    parts = (aircraft, first.condition, sources("aircraft", "flight"), _version("jsbsim"), sys.platform)
    place = kept_in("adopted")
    file = None if place is None else place / f"{hashlib.sha256(repr(parts).encode()).hexdigest()[:32]}.json"
    if file is not None:
        with suppress(Refusal, OSError, ValueError, KeyError, TypeError):  # not there, not ours to read, or damaged
            known = read_json(file, "model")
            return float(known["slowest"]), float(known["fastest"]), (str(known["below"]), str(known["above"]))
    slowest, fastest, ends = _sought(aircraft, first)
    if file is not None:
        keep(file, json.dumps({"slowest": slowest, "fastest": fastest, "below": ends[0], "above": ends[1]}).encode())
    return slowest, fastest, ends


def _sought(aircraft: Aircraft, first: TrimmedFlight) -> tuple[float, float, tuple[str, str]]:
    """Return the slowest speed that trims, to 0.2 %, the fastest, in steps of 8 %, and why those beyond do not.

    A search may fail where speeds on either side of it trim (JSBSim's PC-7 at 60 m/s): one such step is passed over,
    and said.
    """
    ends, reasons = [], []
    design, h_m = first.condition.V_m_s, first.condition.h_m
    for factor, last in ((1.0 / _SPEED_STEP, _SLOWER * design), (_SPEED_STEP, _FASTER * design)):
        end = V = design
        failed, near, missed = "", first, list[str]()
        while (V * factor - last) * (factor - 1.0) < 0.0:
            V *= factor
            try:
                near = trim(aircraft, FlightCondition(V, h_m), near=near, thorough=False)
            except TrimError as error:
                if failed:
                    break
                failed = error.message
            else:
                missed += [f"{V / factor:.3g}"] if failed else []
                end, failed = V, ""
        # The slowest lies between the last speed that trims and the first that does not.
        beyond = end * factor
        while failed and factor < 1.0 and abs(beyond / end - 1.0) > _END:
            middle = 0.5 * (end + beyond)
            try:
                near = trim(aircraft, FlightCondition(middle, h_m), near=near, thorough=False)
            except TrimError as error:
                beyond, failed = middle, error.message
            else:
                end = middle
        ends.append(float(f"{end * (1.0 + _END if failed and factor < 1.0 else 1.0):.3g}"))
        between = f" (between these, none was found at {' and '.join(missed)} m/s)" if missed else ""
        reasons.append((failed or "no trim was sought beyond") + between)
    return ends[0], ends[1], (reasons[0], reasons[1])


def _empty_feeds(fdm: Executive, tree: ET.Element) -> list[int]:
    """Return the empty tanks of engines that no tank with fuel feeds: those that pumps fill once time goes on."""
    out: list[int] = []
    for engine in tree.findall("propulsion/engine"):
        feeds = [int(float(f.text or "-1")) for f in engine.findall("feed")]
        names = {i: f"propulsion/tank[{i}]/contents-lbs" for i in feeds}
        if feeds and all(fdm.has(n) and fdm.get(n) <= 0.0 for n in names.values()):
            out += [i for i in feeds if i not in out]
    return out


def _tanks(fdm: Executive) -> list[float]:
    out = []
    for i in range(40):
        name = f"propulsion/tank[{i}]/contents-lbs"
        if not fdm.has(name):
            break
        out.append(fdm.get(name) * LBF_N / G0_M_S2)
    return out
