"""A small campaign after its flights: a designed elevator input at two speeds and an aileron doublet, rehearsed."""

import math
from pathlib import Path

import numpy as np
from test_bounds import CONTENT

from testbench.design.realise import Errors, Realised
from testbench.evaluation.derivatives import dimensional_derivatives
from testbench.questions.design.ready import Promise, promise_text
from testbench.questions.plan.ask import make_plan
from testbench.questions.plan.close import close_plan
from testbench.questions.plan.flown_card import identify_cards
from testbench.questions.plan.rehearse import rehearse
from testbench.questions.plan.scenario import PlanScenario

SENSORS = {"V": ("m/s", 0.3), "alpha": ("deg", 0.1), "q": ("deg/s", 0.2), "theta": ("deg", 0.1), "az": ("m/s2", 0.1),
           "p": ("deg/s", 0.2), "r": ("deg/s", 0.2), "phi": ("deg", 0.1), "beta": ("deg", 0.1)}  # fmt: skip
NAMES = ("M_alpha", "M_q", "M_de")
DESIGN = """
[identification]
inputs = ["de_cmd"]
outputs = ["alpha", "q"]
[[identification.estimators]]
method = "output_error"
structure = "short_period"
starts = 1
servo = { de_cmd = { lag_s = 0.0303 } }
"""


def promise_of(card, share, *, realised=True, wanted=math.nan, bias=0.0):
    """A promise of ``share`` of every value, with twenty simulated flights whose stated errors are that, or without."""
    believed = {d.name: d.held for d in dimensional_derivatives(card.point.model, card.point.trimmed)}
    values = np.array([believed[n] for n in NAMES])
    one, found = share * np.abs(values), None
    if realised:
        rng = np.random.default_rng(1)
        errors = (bias + share * rng.standard_normal((20, 3))) * np.abs(values)
        stated = one * np.exp(0.1 * rng.standard_normal((20, 3)))
        found = Realised(one, Errors(errors, stated, ()), np.zeros(3, bool))
    return Promise(
        NAMES, values, wanted * np.abs(values), one, {}, card.point.V_m_s, card.point.h_m, "still air", found
    )


def flown_campaign(folder: Path):
    """Return the plan, its log, what was found in it, the identified cards, and their folder."""
    lines = ['title = "What a small autopilot measures"', "rate_hz = 50.0"]
    for name, (unit, std) in SENSORS.items():
        lines += ["[[sensor]]", f'channel = "{name}"', f'unit = "{unit}"', f"noise_std = {std}"]
        lines += ['part = "any"', 'source = "made up"']
    (folder / "suite.toml").write_text("\n".join(lines), encoding="utf-8")
    design = folder / "designs" / "1_x.toml"
    design.parent.mkdir()
    design.write_text(DESIGN, encoding="utf-8")
    manoeuvres = [
        {"name": "elevator", "duration_s": 4.0, "repeats": 2, "design": str(design), "speeds_m_s": [13.0, 15.0],
         "input": [{"signal": "doublet", "control": "de", "amplitude_deg": 1.0, "period_s": 0.8, "start_s": 0.2}]},
        {"name": "aileron", "duration_s": 3.0, "repeats": 1, "speeds_m_s": [13.0],
         "input": [{"signal": "doublet", "control": "da", "amplitude_deg": 1.0, "period_s": 1.2, "start_s": 0.2}]},
    ]  # fmt: skip
    changed = {"manoeuvre": manoeuvres, "speeds_m_s": [13.0, 15.0], "turbulence_rms_m_s": 0.02}
    plan = make_plan(PlanScenario.model_validate({**CONTENT, **changed, "suite": str(folder / "suite.toml")}))
    (folder / "promises").mkdir()
    (folder / "promises" / "1_x.json").write_text(promise_text(promise_of(plan.cards[0], 0.1)), encoding="utf-8")
    (log,) = rehearse(plan, seed=5).values()
    closed = close_plan(plan, [("log", log)])
    return plan, log, closed, identify_cards(closed, folder / "out"), folder
