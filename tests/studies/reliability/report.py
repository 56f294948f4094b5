"""results/reliability.md: what was tried, how often, what came of it, and what no case may come to."""

import os
import platform
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from studies.reliability import commands, treatments
from studies.reliability.cases import ROOT, Row, rows_of
from studies.reliability.small import CASES

from testbench.core.files import write_file

PAGE = ROOT / "results" / "reliability.md"
_HEAD = """# What it bears: every command stopped, starved and misled; damaged files, crashes, very many runs

Made by `make reliability` from the rows in `results/reliability`. Where fewer cases ran than asked for, it says so.
Python {python}; the load of the machine while the cases ran was {load} (median), on {cores} cores.
"A fault" is what no case may come to: a traceback, a hang (no work in a minute, or 300 s of processor), more than 1 GB,
a value read wrongly without a word, lost or doubled runs, other bytes, a file half-written.

## Every command

Each has a small case of a second of processor or so (`small.py` beside the study; a command without one fails a test).
Its folder at the end is held against an undisturbed run's, byte by byte. Columns give trials that ran, of those asked
for:

- stopped: SIGKILL (half of them), SIGTERM, Ctrl-C; a third in the first 50 ms, a third as a drawn file appears, a third
  at any moment. Where several processes work, SIGKILL strikes the first, a worker or all. No file may be half-written,
  and no page stand without its tables. One in four ({again} of 100, {again_others} of 30, always the same) is then run
  again or gone on with to the end, and compared. Of the others the folder is settled, as the next command would, and
  held against its manifest: it is as before, the new result, or a part that is whole (of several folders, or of a
  store that grows).
- {fresh} of 100 and {fresh_others} of 30 stops, and the surroundings, begin a Python of its own that renders its
  figures; the others are forked from one that has imported all, and make their figures without rendering them.
- full disk: no file may grow beyond a size between nothing and the largest that is written; then again with room.
- two at once: into the same folder. damaged: a file that is read, by {damages}.
- streams: `<&-`, `>&-`, `2>&-`, all three, `>/dev/full`, `2>/dev/full`, `| true`. places: the working directory
  removed; files and folders that may be read and not written.
- surroundings: other PYTHONHASHSEED, LC_ALL (C without UTF-8; tr_TR, which is C where it is not installed) and TZ.

Not sampled: Windows and macOS, a machine that loses power, network file systems, the servers of `studio` and
`app`, campaigns on a cluster, options that no case gives.

{commands}
{found}
## Damage, crashes, sizes

| what | asked for | ran | faults | outcomes |
| --- | ---: | ---: | ---: | --- |
"""
FAULTS = (*treatments.FAULTS, "above 1 GB", "read wrongly", "lost", "crashed", "otherwise", "too slow", "growing",
          "accepted", "not begun")  # fmt: skip
_COLUMNS = {
    "stopped": ("stopped",), "full disk": ("full disk",), "two at once": ("two at once",),
    "damaged": ("damaged input",),
    "streams": treatments.STREAM_TREATMENTS, "places": treatments.PLACES, "surroundings": ("surroundings",),
}  # fmt: skip
_MEANT = (
    ("kinds", "mutated files of every kind that is read: TOML, XML, geometry, modes, models, stores, keys", 3000),
    ("nonsense", "nonsensical values and files, none of which may be accepted", 60),
    ("scenarios", "mutated scenarios, suites, structures and ground tests of every kind, read", 3000),
    ("flown", "of these, changed scenarios that were accepted, flown for 20 s of processor at most", 150),
    ("records", "mutated records of every format, 600 each, by one command that reads them, then read again", 7800),
    ("crashes", "campaign with a run in which JSBSim ends the process, in two ways", 2),
    ("sizes", "100 000 rows summarised (20 s of processor at most); 20 000 runs with flat memory", 2),
)


def write() -> Path:
    """Write the page from the rows that are kept; parts without rows here keep what the page says of them."""
    before = PAGE.read_text(encoding="utf-8") if PAGE.exists() else ""
    kept = {part: rows_of(part) for part, _, _ in _MEANT}
    found = commands.rows()
    loads = sorted(float(row["load"]) for rows in (found, *kept.values()) for row in rows)
    load = f"{loads[len(loads) // 2]:.0f}" if loads else "not known"
    text = _HEAD.format(
        python=platform.python_version(), load=load, cores=os.cpu_count(), damages="bits, bytes, numbers and lines",
        commands=_of_commands(found), found=_faults_of(found), **_shares(),
    )  # fmt: skip
    text += "".join(_line(words, meant, kept[part], before) for part, words, meant in _MEANT)
    said = [f"- {row['case']}: {row['said']}" for part in ("crashes", "sizes") for row in kept[part]]
    _, _, figures = before.partition("## Figures\n\n")
    said += [
        line
        for line in figures.partition("\n\n")[0].splitlines()
        if not kept["sizes"] and not any(line.startswith(f"- {row['case']}: ") for row in kept["crashes"])
    ]
    looked = Counter(row["case"].rpartition(" ")[0] for row in kept["records"] if row["outcome"] == "to be looked at")
    text += "\n## Figures\n\n" + "\n".join(said or ["Not measured yet."]) + "\n"
    text += _of_records(looked)
    return write_file(PAGE, text)


def _shares() -> dict[str, int]:
    """Return how many stops of a command are run again, and how many begin a Python of their own."""
    return {
        f"{what}{of}": sum(map(chosen, range(count)))
        for what, chosen in (("again", treatments.run_again), ("fresh", treatments.FRESH.__contains__))
        for of, count in (("", treatments.MOST), ("_others", treatments.OTHERS))
    }


def _of_commands(rows: Sequence[Row]) -> str:
    """Return a table with a row for each case: of each kind of treatment how many ran, of those asked for."""
    heads = ["command", *_COLUMNS, "faults"]
    lines = [f"| {' | '.join(heads)} |", f"| --- |{' ---: |' * (len(heads) - 1)}"]
    total = Counter[str]()
    for name, case in CASES.items():
        mine = [row for row in rows if row["case"].startswith(f"{name}: ")]
        ran = Counter(_column(row["case"].partition(": ")[2]) for row in mine)
        meant = Counter(_column(treatment) for treatment in treatments.treatments(case))
        faults = sum(row["outcome"] in FAULTS for row in mine)
        total.update(ran)
        cells = [f"{ran[c]} of {meant[c]}" if ran[c] < meant[c] else f"{ran[c]}" for c in _COLUMNS]
        lines.append(f"| {name} | {' | '.join(cells)} | {faults if mine else '-'} |")
    lines.append(
        f"| all | {' | '.join(str(total[c]) for c in _COLUMNS)} | {sum(r['outcome'] in FAULTS for r in rows)} |"
    )
    return "\n".join(lines) + "\n"


def _column(treatment: str) -> str:
    kind = treatment.rstrip("0123456789").strip()
    return next(c for c, kinds in _COLUMNS.items() if kind in kinds or treatment in kinds)


def _faults_of(rows: Sequence[Row]) -> str:
    """Return what came of all trials, and what each fault was."""
    lines = [f"{', '.join(f'{n} {o}' for o, n in Counter(row['outcome'] for row in rows).most_common()) or 'Not run'}."]
    lines += [f"- {r['case']}: {r['outcome']}: {r['said']}" for r in rows if r["outcome"] in FAULTS]
    return "\n".join([*lines[:1], "", *lines[1:]]) + "\n"


def _line(words: str, meant: int, rows: Sequence[Row], before: str) -> str:
    if not rows and f"| {words} |" in before:
        return next(line for line in before.splitlines(keepends=True) if line.startswith(f"| {words} |"))
    found = Counter(row["outcome"] for row in rows)
    faults = sum(found[name] for name in FAULTS)
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
