"""Components of the batch's control system against JSBSim's own: random chains of all kinds, flown from trim."""

import re

import numpy as np
import pytest
from side_by_side import INPUTS, SideBySide, differences

from testbench.flight.batch.program import Untranslated

MOST = 1e-12
FRAMES = 240
KINDS = ("lag_filter", "lead_lag_filter", "washout_filter", "second_order_filter", "integrator", "pid", "switch",
         "deadband", "kinematic", "actuator", "sensor", "angle", "pure_gain", "summer", "aerosurface_scale",
         "fcs_function", "distributor")  # fmt: skip


class Chain:
    """Draws channels of components, each of which reads commands and what stands before it."""

    def __init__(self, seed):
        self.rng = np.random.default_rng(seed)
        self.names = list(INPUTS)
        self.written = []

    def number(self, low=0.2, high=20.0):
        return f"{self.rng.uniform(low, high):.6g}"

    def maybe(self, text, share=0.5):
        return text if self.rng.random() < share else ""

    def name(self):
        return self.names[self.rng.integers(len(self.names))]

    def signed(self):
        return self.maybe("-", 0.3) + self.name()

    def parameter(self, low=0.2, high=20.0):
        """A number, or one of two properties: one that stays and one that moves."""
        kind = self.rng.random()
        return self.number(low, high) if kind < 0.6 else "test/stays" if kind < 0.8 else "test/moves"

    def clip(self):
        kind = self.maybe(' type="cyclic"', 0.3)
        ends = f"<min>{self.number(-0.6, -0.1)}</min><max>{self.number(0.05, 0.6)}</max>"
        return self.maybe(f"<clipto{kind}>{ends}</clipto>", 0.4)

    def delay(self):
        kinds = ('<delay type="frames">3</delay>', "<delay>0.041</delay>", '<delay type="time">0.009</delay>')
        return self.maybe(kinds[self.rng.integers(3)], 0.4)

    def condition(self, depth=0):
        comparison = self.rng.choice(["==", "!=", "lt", "GT", "le", "ge", "EQ"]).replace("<", "&lt;")
        lines = [f"{self.name()} {comparison} {self.rng.choice([self.signed(), self.number(-0.3, 0.3)])}"]
        inside = f'<test logic="OR">{self.condition(1)}</test>' if depth == 0 and self.rng.random() < 0.5 else ""
        return "\n".join(lines) + inside + (f"\n{self.name()} ge 0.01" if self.rng.random() < 0.5 else "")

    def inside(self, kind):
        first = f"<input>{self.signed()}</input>"
        if kind in {"lag_filter", "washout_filter"}:
            return first + f"<c1>{self.parameter()}</c1>"
        if kind == "lead_lag_filter":
            return first + "".join(f"<c{i}>{self.parameter(0.2, 3.0)}</c{i}>" for i in range(1, 5))
        if kind == "second_order_filter":
            numbers = [self.number(0.1, 1.0) for _ in range(6)]
            return first + "".join(f"<c{i + 1}>{x}</c{i + 1}>" for i, x in enumerate(numbers))
        rule = self.rng.choice(["", ' type="rect"', ' type="trap"', ' type="ab2"', ' type="ab3"'])
        trigger = self.maybe(f"<trigger>{self.rng.choice(['test/trigger', self.name()])}</trigger>")
        if kind == "integrator":
            return first + f"<c1{rule}>{self.parameter()}</c1>" + trigger
        if kind == "pid":
            gains = f"<kp>{self.parameter()}</kp>" + self.maybe(f"<ki{rule}>{self.parameter()}</ki>", 0.8)
            gains += self.maybe(f"<kd>{self.parameter(0.01, 0.1)}</kd>") + self.maybe(f"<pvdot>{self.name()}</pvdot>")
            return first + gains + trigger
        if kind == "switch":
            tests = "".join(
                f'<test logic="{self.rng.choice(["AND", "OR"])}" '
                f'value="{self.rng.choice([self.signed(), self.number()])}">{self.condition()}</test>'
                for _ in range(self.rng.integers(1, 4))
            )
            return self.delay() + self.maybe(f'<default value="{self.number()}"/>', 0.7) + tests
        if kind == "deadband":
            return first + f"<width>{self.parameter(0.05, 0.5)}</width>" + self.maybe(f"<gain>{self.number()}</gain>")
        if kind == "kinematic":
            ends = np.cumsum([self.rng.uniform(-0.1, 0.0), *self.rng.uniform(0.1, 0.5, self.rng.integers(1, 4))])
            times = [self.rng.choice([0.0, 0.004, 0.1, 0.7], p=[0.1, 0.2, 0.3, 0.4]) for _ in ends]
            settings = "".join(
                f"<setting><position>{x:.5f}</position><time>{t}</time></setting>"
                for x, t in zip(ends, times, strict=True)
            )
            return first + f"<traverse>{settings}</traverse>" + self.maybe("<noscale/>")
        if kind == "actuator":
            limits = self.rng.choice([
                "", f"<rate_limit>{self.parameter(0.2, 2.0)}</rate_limit>",
                f'<rate_limit sense="incr">{self.number(0.2, 2.0)}</rate_limit>',
                f'<rate_limit sense="incr">{self.number(0.2, 2.0)}</rate_limit>'
                f'<rate_limit sense="decr">{self.number(0.2, 2.0)}</rate_limit>',
            ])  # fmt: skip
            rest = self.maybe(f"<lag>{self.parameter()}</lag>") + self.maybe(f"<bias>{self.number(0.0, 0.2)}</bias>")
            rest += self.maybe("<hysteresis_width>0.05</hysteresis_width>") + self.delay()
            return first + limits + rest + self.maybe("<deadband_width>0.04</deadband_width>")
        if kind == "sensor":
            parts = ("<lag>9.0</lag>", "<bias>0.03</bias>", "<gain>1.7</gain>", "<drift_rate>0.02</drift_rate>",
                     f"<quantization name='q{len(self.names)}'><bits>6</bits><min>-1</min><max>1.5</max>"
                     "</quantization>",
                     "<gain>0</gain>", "<lag>0</lag>", self.delay())  # fmt: skip
            return first + "".join(self.maybe(part, 0.3) for part in parts)
        if kind == "angle":
            unit = self.maybe(' unit="DEG"')
            return f"<source_angle{unit}>{self.name()}</source_angle><target_angle>{self.name()}</target_angle>"
        if kind == "pure_gain":
            return first + f"<gain>{self.parameter(0.1, 1.5)}</gain>"
        if kind == "summer":
            return first + f"<input>{self.signed()}</input>" + self.maybe("<bias>0.07</bias>")
        if kind == "aerosurface_scale":
            centred = self.maybe("<zero_centered>false</zero_centered>")
            domain = self.maybe("<domain><min>-2</min><max>1.5</max></domain>")
            return first + domain + "<range><min>-0.4</min><max>0.3</max></range>" + centred
        return (
            "<function><product><property>test/stays</property><max>"
            f"<property>{self.name()}</property><value>-0.1</value></max></product></function>"
        )

    def component(self, kind):
        n = len(self.written)
        if kind == "distributor":
            cases = "".join(
                f"<case>{self.maybe(f'<test>{self.condition()}</test>', 0.8)}"
                f'<property value="{self.rng.choice([self.signed(), self.number()])}">test/d{n}</property></case>'
                for _ in range(3)
            )
            self.written.append(f"test/d{n}")
            kind_of = self.rng.choice(["exclusive", "inclusive"])
            return f'<distributor name="dist {n}" type="{kind_of}">{cases}</distributor>'
        plain = kind in {"pid", "angle"}
        own = f"test/c{n}" if self.rng.random() < 0.5 else f"Part C{n}"
        kind_of = f' type="{self.rng.choice(["standard", "parallel"])}"' if kind == "pid" else ""
        text = f'<{kind} name="{own}"{kind_of}>{self.inside(kind)}'
        output = "" if plain else self.maybe(f"<output>test/o{n}</output>", 0.2)
        self.written.append(own if "/" in own else f"fcs/part-c{n}")
        self.names.append(self.written[-1])
        return f"{text}{self.clip()}{output}</{kind}>"

    def sections(self, channels):
        declared = '<property value="0.7">test/stays</property><property value="0.0">test/trigger</property>'
        text = ""
        for k, (kinds, attributes) in enumerate(channels):
            body = "".join(self.component(kind) for kind in kinds)
            text += f'<channel name="c{k}"{attributes}>{body}</channel>'
        declared += "".join(f'<property value="0.0">{n}</property>' for n in self.written if "/d" in n)
        moving = f"<sum><value>1.5</value><abs><property>{INPUTS[0]}</property></abs></sum>"
        above, below = (
            f"<{tag}><property>{INPUTS[2]}</property><value>{x}</value></{tag}>"
            for tag, x in (("gt", 0.2), ("lt", -0.4))
        )
        trigger = f"<difference>{above}{below}</difference>"
        functions = f'<function name="test/moves">{moving}</function>'
        functions += f'<function name="test/t" copyto="test/trigger">{trigger}</function>'
        return f'<system name="test">{declared}{functions}{text}</system>'


def inputs(seed):
    """Commands (FRAMES, 4): steps, ramps and a wandering, with pauses."""
    rng = np.random.default_rng(seed)
    out = np.cumsum(rng.normal(0.0, 0.05, (FRAMES, 4)) * (rng.random((FRAMES, 4)) < 0.3), axis=0)
    for start in range(0, FRAMES, 40):
        out[start:, rng.integers(4)] += rng.choice([-0.5, 0.5])
    return np.clip(np.round(out, 6), -1.0, 1.0)


def compare(taurus, chain, sections, seed):
    side = SideBySide.of(taurus, sections, chain.written)
    truth, got = side.flown(inputs(seed))
    apart = differences(truth, got)
    frame, k = np.unravel_index(np.argmax(apart), apart.shape)
    first = {n: int(np.argmax(apart[:, i] > MOST)) for i, n in enumerate(chain.written) if np.any(apart[:, i] > MOST)}
    name = chain.written[k].split("/")[-1].removeprefix("part-")
    assert apart[frame, k] < MOST, (first, name, [line for line in sections.split("<channel") if name in line.lower()])
    return truth


@pytest.mark.parametrize("kind", KINDS)
def test_each_kind(taurus, kind):
    chain = Chain(KINDS.index(kind))
    truth = compare(taurus, chain, chain.sections([([kind] * 8, "")]), 7)
    assert np.any(np.ptp(truth, axis=0) > 0.0)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("seed", range(12))
def test_chains_of_all_kinds(taurus, seed):
    chain = Chain(1000 + seed)
    kinds = [list(chain.rng.permutation(KINDS)) for _ in range(2)]
    compare(taurus, chain, chain.sections([(k, "") for k in kinds]), seed)


@pytest.mark.parametrize("seed", range(4))
def test_channels_that_do_not_run_in_every_frame(taurus, seed):
    chain = Chain(2000 + seed)
    attributes = ("", ' execrate="3"', ' execute="test/trigger"', ' execute="test/trigger" execrate="2"')
    compare(taurus, chain, chain.sections([(list(chain.rng.permutation(KINDS)), a) for a in attributes]), seed)


def channel(*components, declared=""):
    return f'<system name="test">{declared}<channel name="c">{"".join(components)}</channel></system>'


def told(name, index):
    """A component that writes a property with whether a command is positive."""
    test = f'<test value="1">{INPUTS[index]} gt 0</test>'
    return f'<switch name="test/told-{index}"><default value="0"/>{test}<output>{name}</output></switch>'


def test_failures_that_the_model_switches(taurus):
    limits = "<clipto><min>-0.3</min><max>0.4</max></clipto>"
    inside = (
        f"<input>{INPUTS[0]}</input><lag>8</lag><rate_limit>1.5</rate_limit><hysteresis_width>0.02</hysteresis_width>"
    )
    actuator = f'<actuator name="test/a">{inside}{limits}</actuator>'
    sensor = f'<sensor name="Test S"><input>{INPUTS[0]}</input>{limits}</sensor>'
    failures = ("test/a/malfunction/fail_zero", "test/a/malfunction/fail_hardover", "test/a/malfunction/fail_stuck")
    for name in (*failures, "fcs/test-s/malfunction/fail_low", "fcs/test-s/malfunction/fail_high"):
        names = ("test/a", "test/a/saturated", "fcs/test-s")
        side = SideBySide.of(taurus, channel(actuator, sensor, told(name, 1)), names)
        truth, got = side.flown(inputs(3))
        assert differences(truth, got).max() < MOST, name
        healthy = SideBySide.of(taurus, channel(actuator, sensor), names).flown(inputs(3))[0]
        assert np.any(truth != healthy)
        assert np.any(healthy[:, 1] == 1.0)


def test_sensors_of_the_motion(taurus):
    place = '<location unit="M"><x>-0.2</x><y>0.1</y><z>0.05</z></location>'
    turned = '<orientation unit="DEG"><roll>10</roll><pitch>-20</pitch><yaw>30</yaw></orientation>'
    parts = [
        f'<{kind} name="test/{kind}-{axis}">{place}{turned if axis != "y" else ""}<axis>{axis.upper()}</axis></{kind}>'
        for kind in ("gyro", "accelerometer")
        for axis in "xyz"
    ]
    names = [f"test/{kind}-{axis}" for kind in ("gyro", "accelerometer") for axis in "xyz"]
    truth, got = SideBySide.of(taurus, channel(*parts), names).flown(0.2 * inputs(5))
    assert np.all(np.ptp(truth, axis=0) > 0.1)
    assert differences(truth, got).max() < 1e-10  # what they measure agrees no better


def test_rates_of_the_angles_are_those_of_jsbsim_and_of_a_turning_body(taurus):
    """psidot cos(theta) = q sin(phi) + r cos(phi), phidot = p + psidot sin(theta): the body's rates, turned."""
    angles = ("phi", "theta", "psi")
    names = [*(f"velocities/{n}dot-rad_sec" for n in angles), *(f"velocities/{n}-rad_sec" for n in "pqr")]
    names += [f"attitude/{n}-rad" for n in angles[:2]]
    truth, got = SideBySide.of(taurus, "", names).flown(inputs(5))
    assert np.all(np.ptp(truth, axis=0) > 0.01)
    assert differences(truth, got).max() < 1e-10
    phidot, _, psidot, p, q, r, phi, theta = got[1:].T
    np.testing.assert_allclose(psidot * np.cos(theta), q * np.sin(phi) + r * np.cos(phi), rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(phidot, p + psidot * np.sin(theta), rtol=0.0, atol=1e-12)


NOISE = "<noise variation='ABSOLUTE' distribution='GAUSSIAN'>0.1</noise>"
NOISY = f"<sensor name='test/noisy'><input>aero/alpha-rad</input>{NOISE}</sensor>"
RANDOM = "<fcs_function name='test/random'><function><random/></function></fcs_function>"
PLACE = "<location unit='IN'><x>0</x><y>0</y><z>0</z></location>"
FIELD = f"<magnetometer name='test/field'>{PLACE}<axis>X</axis></magnetometer>"
NAMED = "<product name='test/inner'><value>2</value><value>3</value></product>"
INNER = f"<fcs_function name='test/outer'><function><sum>{NAMED}<value>1</value></sum></function></fcs_function>"


@pytest.mark.parametrize(
    ("component", "read", "said"),
    [
        (NOISY, "test/noisy", "the sensor test/noisy has noise"),
        (RANDOM, "test/random", "it has the function <random>"),
        (FIELD, "test/field", "it has the component <magnetometer>"),
        (INNER, "test/inner", "it reads test/inner"),
        ("", "simulation/frame", "it reads simulation/frame"),
    ],
)
def test_what_is_not_translated_stops_only_what_flies_by_it(taurus, component, read, said):
    def gain(output):
        return f"<pure_gain name='test/gain'><input>{read}</input><gain>0.1</gain>{output}</pure_gain>"

    side = SideBySide.of(taurus, channel(component, gain("")), [])
    plain = SideBySide.of(taurus, "", [])
    assert side.model.program.frame.shape == plain.model.program.frame.shape
    with pytest.raises(Untranslated, match=said):
        SideBySide.of(taurus, channel(component, gain("<output>atmosphere/gust-down-fps</output>")), [])
    with pytest.raises(Untranslated, match=said):
        SideBySide.of(taurus, channel(component, gain("")), ["test/gain"])


def test_numbers_do_not_shape_the_program(taurus):
    """Every number of a chain of all kinds made a zero: the program is the same, and so is what JSBSim computes."""
    chain = Chain(42)
    sections = chain.sections([(list(KINDS), "")])
    programs = []
    for text in (sections, re.sub(r"<(bias|lag|gain|drift_rate|deadband_width|hysteresis_width|width|kp|kd)>[\d.]+<",
                                  r"<\1>0<", sections)):  # fmt: skip
        side = SideBySide.of(taurus, text, chain.written)
        truth, got = side.flown(inputs(1))
        assert differences(truth, got).max() < MOST
        programs.append(side.model.program)
    assert np.array_equal(programs[0].frame, programs[1].frame)
