"""Description files, so that what is handed out can go straight into `testbench identify` and its like."""

from __future__ import annotations

from collections.abc import Sequence

from testbench.core.channels import channel


def description(
    title: str,
    records: Sequence[str],
    channels: Sequence[str],
    inputs: Sequence[str],
    outputs: Sequence[str],
    estimators: str,
    trim_s: float = 0.0,
    held_out: Sequence[str] = (),
) -> str:
    """Return a description (TOML) of the records of an exercise, the last 30 % of each held out if no others are.

    Args:
        title: of the exercise.
        records: names of the files in records/.
        channels: that they hold.
        inputs: of what is to be identified.
        outputs: of what is to be identified.
        estimators: the tables ``[[identification.estimators]]`` as TOML.
        trim_s: steady flight before the manoeuvre, whose mean is taken off; 0 for records of deviations.
        held_out: names of the files in records/ to judge by.
    """
    lines = [
        f'title = "{title}"',
        'source = "simulated for an exercise of the test bench"',
        'rights = "none needed"',
        'folder = "."',
        f"trim_s = {float(trim_s)!r}",
        "[time]",
        'column = "t"',
    ]
    uses = dict.fromkeys(records, "identification" if held_out else "split")
    for name, use in {**uses, **dict.fromkeys(held_out, "validation")}.items():
        lines += ["[[record]]", f'name = "{name}"', f'file = "records/{name}.nc"', f'use = "{use}"']
    for name in channels:
        lines += ["[[channel]]", f'name = "{name}"', f'column = "{name}"', f'unit = "{channel(name).unit}"']
    quoted = [", ".join(f'"{n}"' for n in names) for names in (inputs, outputs)]
    lines += [
        "[preparation]",
        f'bias = "{"trim" if trim_s else "none"}"',
        "identification_fraction = 0.7",
        "[identification]",
    ]
    lines += [f"inputs = [{quoted[0]}]", f"outputs = [{quoted[1]}]", estimators.strip()]
    return "\n".join(lines) + "\n"
