"""Every number of every file has a unit and a range, and what lies beyond is refused with both."""

import tomllib
from collections.abc import Iterator
from importlib import import_module
from pkgutil import walk_packages

import pytest

import testbench
from testbench.core.paths import SCENARIOS
from testbench.core.schema import QUANTITIES, Strict, parse, quantity
from testbench.questions.files import WITH_FILES, file_classes, json_schemas
from testbench.sensors.sensor import Sensor
from testbench.sensors.suite import load_suite

_LOW, _HIGH = {"minimum", "exclusiveMinimum"}, {"maximum", "exclusiveMaximum"}
_OPTIONAL = ("testbench.envs", "testbench.__main__")


def classes(of: type = Strict) -> Iterator[type[Strict]]:
    for one in of.__subclasses__():
        yield one
        yield from classes(one)


def numbers(node: object, name: str = "") -> Iterator[tuple[str, dict]]:
    """Name and schema of every number of a JSON schema."""
    if isinstance(node, dict):
        if node.get("type") in ("number", "integer"):
            yield name, node
        for key, value in node.items():
            for each, inner in value.items() if key in ("properties", "$defs") else [(name, value)]:
                yield from numbers(inner, each)
    elif isinstance(node, list):
        for inner in node:
            yield from numbers(inner, name)


@pytest.fixture(scope="module")
def of_the_package():
    for module in walk_packages(testbench.__path__, "testbench."):
        if not module.name.startswith(_OPTIONAL):
            import_module(module.name)
    return [c for c in classes() if c.__module__.startswith("testbench")]


def test_every_number_of_every_schema_has_a_range(of_the_package):
    assert len(of_the_package) > 100
    found = [(c.__name__, *each) for c in of_the_package for each in numbers(c.model_json_schema())]
    assert len(found) > 700
    assert {(c, name) for c, name, n in found if not (_LOW & n.keys() and _HIGH & n.keys())} == set()


def test_a_field_without_a_row_is_found():
    class Strange(Strict):
        wingspread: float

    assert quantity("wingspread") is None
    assert [n for n, s in numbers(Strange.model_json_schema()) if not _HIGH & s.keys()] == ["wingspread"]


def test_keys_that_carry_no_unit_have_a_row_of_their_own():
    """The end of a key names the unit; where it does not, the whole key or its end stands in the table."""
    assert all(q.low < q.high for q in QUANTITIES.values())
    assert quantity("design_V_m_s").unit == quantity("wind_north_m_s").unit == "m/s"
    assert quantity("design_V_m_s").low > 0.0 > quantity("wind_north_m_s").low
    assert quantity("tail_roll_inertia_kg_m2").unit == "kg m2"


def test_schemas_of_all_kinds_carry_units():
    schemas = json_schemas()
    assert schemas.keys() == file_classes().keys() >= {"suite", "aircraft", "geometry", "prior", "structure"}
    V = schemas["scenario"]["$defs"]["Condition"]["properties"]["V_m_s"]
    assert (V["unit"], V["minimum"], V["maximum"]) == ("m/s", 0.1, 1000.0)
    optional = schemas["scenario"]["$defs"]["Simulation"]["properties"]["rate_hz"]
    assert optional["unit"] == "Hz"


@pytest.mark.parametrize("question", WITH_FILES, ids=lambda q: q.command)
def test_schemas_take_the_packaged_files_and_refuse_what_the_testbench_refuses(question):
    """The second implementation is a validator of JSON schemas, as editors have one."""
    jsonschema = pytest.importorskip("jsonschema", reason="schemas need jsonschema to be tried")
    validator = jsonschema.Draft202012Validator(json_schemas()[question.kind])
    content = {}
    for file in sorted((SCENARIOS / question.folder).glob("*.toml"))[:4]:
        content = tomllib.loads(file.read_text(encoding="utf-8"))
        assert [f"{file.name}: {error.message}" for error in validator.iter_errors(content)] == []
    (refused,) = validator.iter_errors(content | {"not_a_key": 1})
    assert "not_a_key" in refused.message


class Both(Strict):
    lag_s: float
    f_hz: float | None = None
    V_m_s: tuple[float, ...] = ()


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ({"lag_s": 5e4}, "lag_s: must be 0 to 60 s, got 50000.0"),
        ({"lag_s": 1.0, "f_hz": 1e9}, "f_hz: must be 1e-05 to 20000 Hz, got 1000000000.0"),
        ({"lag_s": 1.0, "V_m_s": (12.0, 1e30)}, "V_m_s[1]: must be 0.1 to 1000 m/s, got 1e+30"),
    ],
)
def test_the_refusal_says_range_and_unit(content, words):
    made, faults = parse(Both, content, "f.toml")
    assert made is None
    assert faults == [f"f.toml, {words}"]


def test_readings_are_held_against_what_their_channel_can_be():
    assert Sensor("h", noise_std=2000.0).noise_std == 2000.0
    with pytest.raises(Exception, match=r"noise_std: 0 <= noise_std <= 10 must hold, got 2000"):
        Sensor("alpha", noise_std=2000.0)
    assert load_suite("eolo_alpha").channels
