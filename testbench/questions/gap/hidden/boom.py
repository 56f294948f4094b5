"""A hidden tail boom that rings.

Shares no code with the library of effects; neither imports the other (tests/test_house_rules.py).
"""

from __future__ import annotations

import math

from testbench.aircraft import Insert
from testbench.flight import load_aircraft
from testbench.questions.gap.hidden.aircraft import RATE_HZ
from testbench.questions.gap.hidden.terms import ELEVATOR, coefficient, number, prop, term
from testbench.questions.gap.hidden.truth import Size, Truth


def boom(s: Size, aircraft: str) -> Truth:
    """A tail boom that rings with the elevator's load: eta'' + 2 z w eta' + w^2 eta = w^2 de qbar / qbar0, Cm += c eta.

    Stepped exactly for a load that is held at its mean over a frame. qbar0 is the dynamic pressure at design speed, at
    sea level.
    """
    w, z, dt = 2.0 * math.pi * s["f_hz"], s.get("zeta", 0.03), 1.0 / RATE_HZ
    wd = w * math.sqrt(1.0 - z * z)
    e, c, n = math.exp(-z * w * dt), math.cos(wd * dt), math.sin(wd * dt)
    a11, a12 = e * (c + z * w / wd * n), e * n / wd
    a21, a22 = -e * w * w / wd * n, e * (c - z * w / wd * n)
    x, v, nx, last = "hidden/boom-x", "hidden/boom-v", "hidden/boom-nx", "hidden/boom-load"
    qbar0 = 0.5 * 1.225 * load_aircraft(aircraft, "rigid").design_V_m_s ** 2 / 47.880259
    load_now = term("quotient", term("product", prop(ELEVATOR), prop("aero/qbar-psf")), number(qbar0))
    mean = term("product", number(0.5), term("sum", load_now, prop(last)))
    off = term("difference", prop(x), mean)
    moved, turned = (
        term("sum", term("product", number(a), off), term("product", number(b), prop(v)))
        for a, b in ((a11, a12), (a21, a22))
    )

    def go(body: str, rest: str) -> str:
        runs = term("gt", prop("simulation/dt"), number(0.0))
        return term("ifthen", runs, term("sum", body, number(0.0)), term("sum", rest, number(0.0)))

    steps = (
        (nx, go(term("sum", mean, moved), load_now)),
        (v, go(turned, number(0.0))),
        (x, go(prop(nx), load_now)),
        (last, term("sum", load_now, number(0.0))),
    )
    parts = "".join(
        f'<fcs_function name="{name}-f"><function>{body}</function><output>{name}</output></fcs_function>'
        for name, body in steps
    )
    edits = [Insert("flight_control", f'<property value="0">{name}</property>', 0) for name in (x, v, nx, last)]
    edits.append(Insert("flight_control", f'<channel name="boom">{parts}</channel>'))
    return Truth(changes=(*edits, coefficient("PITCH", number(s["Cm"]), prop(x))))
