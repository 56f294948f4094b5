"""results/reliability.md: what was tried, how often, what came of it, and what no case may come to."""

from __future__ import annotations

import platform
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from studies.reliability.cases import ROOT, Row, rows_of

from testbench.core.files import write_file

PAGE = ROOT / "results" / "reliability.md"
_HEAD = """# What it bears: kills, damage, a full disk, crashes, very many runs

Made by `make reliability` from the rows in `build/reliability`. Where fewer cases ran than asked for, it says so.
Python {python}; the load of the machine while the cases ran was {load} (median), on {cores} cores.
"A fault" is what no case may come to: a traceback, a hang (300 s), more than 1 GB, a value read wrongly without a word,
lost or doubled runs, other bytes, a file half-written.

| what | asked for | ran | faults | outcomes |
| --- | ---: | ---: | ---: | --- |
"""
_FAULTS = ("traceback", "hung", "above 1 GB", "read wrongly", "lost", "other bytes", "not gone on", "half-written",
           "crashed", "otherwise", "too slow", "growing")  # fmt: skip
_MEANT = (
    ("scenarios", "mutated scenarios, suites, structures and ground tests of every kind, read", 3000),
    ("flown", "of these, changed scenarios that were accepted, flown for 20 s of processor at most", 150),
    ("records", "mutated records of every format, 600 each, by one command that reads them, then read again", 7800),
    (
        "kills_campaign",
        "SIGKILL of `campaign run` at a random moment, then `campaign resume`",
        100,
    ),
    ("kills_plan", "SIGKILL of `plan show`, then the same again", 100),
    ("kills_gap_--controls", "SIGKILL of `gap --controls`, then the same again", 100),
    ("kills_blind_test", "SIGKILL of the blind test, then the same again", 100),
    ("disk", "import, export and plan without room for a file, 50 sizes each", 150),
    ("crashes", "campaign with a run in which JSBSim ends the process, in two ways", 2),
    ("sizes", "100 000 rows summarised (20 s of processor at most); 20 000 runs with flat memory", 2),
)


def write() -> Path:
    """Write the page from the rows that are kept."""
    kept = {part: rows_of(part) for part, _, _ in _MEANT}
    loads = sorted(float(row["load"]) for rows in kept.values() for row in rows)
    load = f"{loads[len(loads) // 2]:.0f}" if loads else "not known"
    import os

    text = _HEAD.format(python=platform.python_version(), load=load, cores=os.cpu_count())
    text += "".join(_line(words, meant, kept[part]) for part, words, meant in _MEANT)
    said = [f"- {row['case']}: {row['said']}" for part in ("crashes", "sizes") for row in kept[part]]
    looked = Counter(row["case"].rpartition(" ")[0] for row in kept["records"] if row["outcome"] == "to be looked at")
    text += "\n## Figures\n\n" + "\n".join(said or ["Not measured yet."]) + "\n"
    text += _of_records(looked)
    return write_file(PAGE, text)


def _line(words: str, meant: int, rows: Sequence[Row]) -> str:
    found = Counter(row["outcome"] for row in rows)
    faults = sum(found[name] for name in _FAULTS)
    shown = ", ".join(f"{count} {name}" for name, count in found.most_common()) or "not run"
    return f"| {words} | {meant} | {len(rows)} | {faults if rows else '-'} | {shown} |\n"


def _of_records(looked: Counter[str]) -> str:
    head = "\n## Damaged records that read as another flight, without a question\n\n"
    why = (
        "Of these, most samples of a channel differ from the undamaged flight by more than 2 % of its range, at the\n"
        "same times. They are no faults before someone has looked at each: a number, a unit or a name that became\n"
        "another valid one is what the file says.\n\n"
    )
    lines = [f"- {name}: {count}" for name, count in looked.most_common()] or ["None."]
    return head + why + "\n".join(lines) + "\n"
