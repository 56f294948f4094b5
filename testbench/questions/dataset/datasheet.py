"""The datasheet of a data set: what it is, how it was drawn, its units and sizes, and how to open and remake it.

Its sections are those of T. Gebru et al., "Datasheets for Datasets", Communications of the ACM 64(12), 2021, as far as
they concern simulated flights.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from testbench.core.channels import channel
from testbench.core.escape import markdown_cell, markdown_table, shell_word
from testbench.core.paths import SCENARIOS
from testbench.questions.campaign.load import versions
from testbench.questions.dataset.layout import Layout, label
from testbench.questions.dataset.scenario import SPLITS, DatasetScenario, Level
from testbench.sensors import load_suite

_TASKS = {
    "identification": "Estimate the derivatives and modes of the aircraft (`truth`) from the flights of each draw.",
    "naming": "Name what the believed model of the aircraft lacks (`effect`), if anything, from the flights of a draw.",
}


def datasheet(
    scenario: DatasetScenario,
    layout: Layout,
    split: Any,
    samples: Any,
    labels: Mapping[str, Any],
    again: Mapping[str, int],
) -> str:
    """Return the datasheet as Markdown.

    Args:
        scenario: that it was drawn by.
        layout: of the store.
        split: (flights,) codes.
        samples: (flights,) of each record.
        labels: all labels, those of the test split too; only counts of them are told.
        again: why draws were drawn again -> how often.
    """
    counts = {name: int(np.sum(split == i)) for i, name in enumerate(SPLITS)}
    seconds = float(np.sum(samples)) / layout.rate_hz
    file = scenario.file.name if scenario.file else "scenario.toml"
    packaged = scenario.file is not None and scenario.file.is_relative_to(SCENARIOS)
    file = file.removesuffix(".toml") if packaged else file
    parts = [
        f"# {markdown_cell(scenario.title)}\n",
        f"{scenario.question}\n" if scenario.question else "",
        "## What it holds\n",
        f"{layout.flights} simulated flights of {layout.draws} draws, {seconds / 3600.0:.3g} h in all. "
        f"{_TASKS[layout.task]}\n",
        _table(("split", "flights", "draws"), [(n, c, -(-c // layout.per_draw)) for n, c in counts.items()]),
        "The labels of the test split are NaN or -2 in `flights.h5`; they lie in `truth_test.h5`. Whoever knows "
        "scenario and seed can draw them again: a contest takes a `--seed` of its own and keeps `truth_test.h5` and "
        "`dataset.json` back.\n",
        f"One flight takes {layout.row_bytes} bytes, of which the readings are "
        f"{layout.samples * len(layout.channels) * 4}: {layout.samples} samples at {layout.rate_hz:g} Hz of "
        f"{len(layout.channels)} channels of 4 bytes. Nothing is compressed.\n",
        "## How it was drawn\n",
        _how(scenario),
        _again(again),
        "The flights of a draw share aircraft, condition and hidden effects, and lie in one split: the SHA-256 of what "
        "was drawn decides which. A larger data set of the same seed begins with the same draws.\n",
        "## Channels\n",
        _channels(scenario),
        "## Variables\n",
        _table(
            ("variable", "dimensions", "type", "unit", "what it is"),
            [(f"`{v.name}`", ", ".join(v.dims), v.dtype[1:], v.unit, v.words + ("; a label" if v.label else ""))
             for v in layout.variables],
        ),
        "Codes are places in the attribute `names` of their variable.\n",
        "## True figures\n",
        _table(("figure", "unit"), list(zip(layout.figures, (u or "1" for u in layout.figure_units), strict=True))),
        _effects(layout),
        "## What it is not\n",
        "The flights are simulated. Aircraft, sensors and air are those of the testbench's models; how far these are "
        "from an aircraft of yours is not told by any number here. Draws that could not fly are left out, so that "
        "conditions near the limits of an aircraft are rarer than the laws above say.\n",
        "## Licence, version, command\n",
        f"Licence: {markdown_cell(scenario.licence)}. The seed stands in `dataset.json`, as the whole scenario does. "
        f"Versions: {', '.join(f'{k} {v}' for k, v in versions().items())}.\n",
        f"```sh\ntestbench dataset {shell_word(file)} --runs {layout.flights} --out FOLDER\n```\n",
        "`testbench dataset check FOLDER`, or `sha256sum -c checksums.sha256` in it, checks the files.\n",
        "```python\nimport testbench as tb\n\nflights = tb.open_dataset(\"FOLDER\")\n```\n",
    ]  # fmt: skip
    return "\n".join(p for p in parts if p)


def _channels(scenario: DatasetScenario) -> str:
    """Return the channels with what their sensors are believed to be, before levels and hidden effects."""
    sensed = load_suite(scenario.suite)
    rows = [
        (
            s.channel,
            channel(s.channel).unit,
            *(f"{x:.3g}" for x in (s.noise_std, s.bias, s.lag_s, s.delay_s, s.quantum)),
        )
        for s in sensed.sensors
    ]
    heads = ("channel", "unit", "noise std", "bias", "lag, s", "delay, s", "quantum")
    return _table(heads, rows)


def _how(scenario: DatasetScenario) -> str:
    inputs = [
        (m.name, ", ".join(s.signal + " on " + s.control for s in m.input), m.duration_s) for m in scenario.manoeuvre
    ]
    return "\n".join(
        [
            _table(("level", "share", "how"), [(x.name, x.share, _words(x)) for x in scenario.level]),
            _table(("manoeuvre", "inputs", "duration, s"), inputs),
        ]
    )


def _words(level: Level) -> str:
    def between(pair: tuple[float, float], unit: str = "") -> str:
        low, high = pair
        return f"{low:g}{unit}" if low == high else f"{low:g} to {high:g}{unit}"

    out = [
        f"{' or '.join(label(x) for x in level.aircraft)}, {level.wings} wings",
        f"{between(level.speed_ratio)} of the design airspeed at {between(level.h_m, ' m')}",
        f"inputs times {between(level.scale)}",
        f"sensor errors times {level.noise:g}",
    ]
    if level.turbulence_rms_m_s[1] > 0.0:
        out.append(f"turbulence of {between(level.turbulence_rms_m_s, ' m/s')} rms")
    for key, law in level.vary.items():
        values = ", ".join(f"{k} {v}" for k, v in law.model_dump().items() if k != "kind" and v not in ((), None))
        out.append(f"`{key}` {law.kind} ({values})")
    if level.hidden:
        out.append(f"hidden: {', '.join(level.hidden)}")
    return "; ".join(out)


def _again(again: Mapping[str, int]) -> str:
    if not again:
        return "Every draw flew at its first attempt.\n"
    reasons = _table(("times", "drawn again because"), [(n, why) for why, n in again.items()])
    return f"Attempts that could not fly: {sum(again.values())}. They were drawn again.\n\n{reasons}"


def _effects(layout: Layout) -> str:
    if not layout.effects:
        return ""
    rows = [(k, p, r.replace("|", "or")) for k, p, r in zip(layout.effects, layout.parts, layout.right, strict=True)]
    return "## Hidden effects\n\n" + _table(("effect", "part", "right names"), rows)


def _table(heads: tuple[str, ...], rows: list[tuple[Any, ...]]) -> str:
    return "\n".join(markdown_table(heads, rows)) + "\n"
