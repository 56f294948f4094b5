"""What a scenario may name: the members of each family, as tables."""

from __future__ import annotations

from collections.abc import Callable

from testbench.core.door import read_toml
from testbench.core.paths import AIRCRAFT_MODELS, SCENARIOS, aircraft_names, suite_names
from testbench.questions.files import WITH_FILES

Rows = list[tuple[str, ...]]


def aircraft() -> Rows:
    """Return the packaged aircraft; the first row holds the heads, as in all tables here."""
    return [("aircraft", "what it is"), *((n, _title(n)) for n in aircraft_names())]


def _title(name: str) -> str:
    return str(read_toml(AIRCRAFT_MODELS / name / "aircraft.toml", "aircraft").get("title", ""))


def inputs() -> Rows:
    """Return the families of signals."""
    from testbench.inputs import FAMILIES

    return [("signal", "what it is"), *((n, text) for n, (_, text) in FAMILIES.items())]


def sensors() -> Rows:
    """Return the packaged sensor suites."""
    from testbench.sensors import load_suite

    suites = [load_suite(n) for n in suite_names()]
    return [
        ("suite", "rate", "channels", "what it is"),
        *((s.name, f"{s.rate_hz:g} Hz", ", ".join(s.channels), s.title) for s in suites),
    ]


def estimators() -> Rows:
    """Return the methods of estimation, what each needs and gives."""
    from testbench.estimators import METHODS, Method

    def words(method: Method) -> str:
        needs = f"; needs: {', '.join(method.needs)}" if method.needs else ""
        return f"{method.words}{needs}; gives: {', '.join(method.gives)}"

    return [("method", "what it is, what it needs, what it gives"), *((n, words(m)) for n, m in METHODS.items())]


def structures() -> Rows:
    """Return the packaged model structures, and examples of equations as text."""
    from testbench.estimators.equations import read_equations
    from testbench.estimators.parametric.structures import STRUCTURES

    texts = sorted((SCENARIOS / "structures").glob("*.toml"))
    return [
        ("structure", "what it is"),
        *((name, family.description) for name, family in STRUCTURES.items()),
        *((f"structures/{path.name}", read_equations(path).title) for path in texts),
    ]


def scenarios() -> Rows:
    """Return the packaged files of all questions."""
    rows: Rows = [("scenario", "command", "title")]
    for question in WITH_FILES:
        for path in sorted((SCENARIOS / question.folder).glob("*.toml")):
            name = f"{question.folder}/{path.stem}".lstrip("/")
            rows.append((name, question.command, str(read_toml(path).get("title", ""))))
    return rows


def effects() -> Rows:
    """Return the effects that the gap workflow can name."""
    from testbench.effects import EFFECTS, OTHER_SERVOS

    beside = "weighed where an effect in its path comes near, or by name"
    further = ((n, f"({beside}) {e.physics}") for n, e in OTHER_SERVOS.items())
    return [("effect", "physics"), *((n, e.physics) for n, e in EFFECTS.items()), *further]


FAMILIES: dict[str, Callable[[], Rows]] = {
    f.__name__: f for f in (aircraft, inputs, sensors, estimators, structures, scenarios, effects)
}
"""What `testbench list` can list."""
