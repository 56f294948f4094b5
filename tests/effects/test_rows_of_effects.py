"""The contract of every row of the tables of effects: words, units, bounds, a known part, a form error, a place to be
searched; and no table, or row, is forgotten."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import pytest

from testbench import effects
from testbench.effects import EFFECTS, ON_REQUEST, SERVOS, Effect, Parameter, aerodynamics
from testbench.effects.base import together
from testbench.effects.sensor import sensor_effects
from testbench.questions.gap import effect_contract as contract
from testbench.questions.gap.parts import part_names, parts_of

CHANNELS = ("V", "alpha", "beta", "p", "q", "r", "theta", "phi", "psi", "ax", "ay", "az", "h", "hdot", "Vg")
ROWS = EFFECTS | ON_REQUEST | sensor_effects(CHANNELS, pitot=True)
MODULES = [importlib.import_module(f"testbench.effects.{m.name}") for m in pkgutil.iter_modules(effects.__path__)]


def held(module: ModuleType) -> Iterator[Effect]:
    """Effects that a module holds, by themselves or in a table."""
    for thing in vars(module).values():
        each = thing.values() if isinstance(thing, dict) else thing if isinstance(thing, tuple) else (thing,)
        yield from (e for e in each if isinstance(e, Effect))


def forgotten(module: ModuleType) -> set[str]:
    """Names of the effects of a module that neither the library nor ON_REQUEST holds."""
    return {e.name for e in held(module) if ROWS.get(e.name) is not e and SERVOS.get(e.name) is not e}


@pytest.mark.parametrize("module", MODULES, ids=lambda m: m.__name__)
def test_no_table_and_no_row_is_forgotten(module):
    assert forgotten(module) == set()
    assert any(held(module)) or module.__name__.endswith((".base", ".sensor")), "a file here is a table"


def test_a_table_that_the_library_does_not_know_is_found():
    module = ModuleType("new_table")
    module.EFFECTS = (replace(EFFECTS["stall"], name="new_stall"),)
    assert forgotten(module) == {"new_stall"}
    module.EFFECTS = (replace(EFFECTS["stall"]),)  # a second one of the same name
    assert forgotten(module) == {"stall"}


def test_an_effect_is_in_the_library_or_on_request():
    assert not EFFECTS.keys() & ON_REQUEST.keys()
    assert {e.name for e in SERVOS.values()} <= ROWS.keys()
    rows = [e.name for m in MODULES for e in (*getattr(m, "EFFECTS", ()), *getattr(m, "ON_REQUEST", ()))]
    assert len(rows) == len(set(rows)), "a name is that of one row"


@pytest.mark.parametrize("law", contract.OF_WORDS, ids=lambda law: law.__name__)
@pytest.mark.parametrize("name", ROWS)
def test_a_row_keeps_the_laws_of_words(name, law):
    assert law(contract.Trial(ROWS[name])) is None
    assert ROWS[name].name == name


@pytest.mark.parametrize("name", ROWS)
def test_a_row_leads_to_a_known_part_with_a_check_on_the_ground(name):
    effect = ROWS[name]
    (part,), names = parts_of([effect]), part_names(effect)
    (unknown,) = parts_of([replace(effect, part="no such part", ground_check="")])
    assert (part.name,) == names
    assert part.ground_check
    assert part.ground_check != unknown.ground_check, f"{part.name} must be a part of parts.py, or the row have a check"


@pytest.mark.parametrize("name", ROWS)
def test_a_row_says_how_far_its_form_may_be_off_and_what_it_contains(name):
    effect = ROWS[name]
    assert 0.005 <= effect.form_error <= 0.3
    assert {*effect.contains, *((effect.own_form,) if effect.own_form else ())} <= ROWS.keys() - {name}
    assert len({p.name for p in effect.parameters}) == len(effect.parameters)


def test_the_form_error_of_several_is_the_largest():
    assert together(EFFECTS["cg_shift"], EFFECTS["stall"]).form_error == EFFECTS["stall"].form_error > 0.01


def test_exact_forms_are_closer_than_linear_ones_and_those_than_curved_ones():
    """Gains, offsets and masses 0.01; lags and delays 0.02; linear terms 0.03; play 0.05; stall and propeller 0.1."""
    expected = {
        0.01: ("surface_scale", "aileron_surface_scale", "surface_offset", "thrust_scale", "cg_shift", "V_scale"),
        0.02: ("actuator_lag", "rudder_lag", "transport_delay", "thrust_lag", "clock_offset"),
        0.03: ("alpha_dot", "drag_increment", "pitch_damper", "rate_limit", "asymmetric_lift"),
        0.05: ("free_play", "creeping_free_play", "dead_band", "throttle_dead_band", "throttle_free_play"),
        0.1: ("stall", "stall_hysteresis", "curved_linkage", "slipstream", "p_factor", "ground_effect", "gust"),
    }
    assert {n: ROWS[n].form_error for names in expected.values() for n in names} == {
        n: size for size, names in expected.items() for n in names
    }


def test_what_is_made_outside_may_leave_the_form_error_to_the_default():
    size = (Parameter("x", "1", -1.0, 1.0, (0.1,)),)
    assert Effect("mine", "mine", "lift", "One. Two.", size, EFFECTS["stall"].amend, "a", "b").form_error == 0.03


def test_the_row_of_the_guide_is_one_of_the_tables():
    text = (Path(__file__).resolve().parents[2] / "docs/guides/add_an_effect.md").read_text(encoding="utf-8")
    _, row, _ = text.split("```", 2)
    assert row.removeprefix("text\n") in Path(aerodynamics.__file__).read_text(encoding="utf-8")
