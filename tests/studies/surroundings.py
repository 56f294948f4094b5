"""Does the testbench hold in other surroundings: no extras, home, room or locale, oldest and newest packages?

    python tests/studies/surroundings.py                     # the quick tests in each; a few minutes and downloads
    python tests/studies/surroundings.py --only no-locale    # in one
    python tests/studies/surroundings.py --tests tests       # the whole suite in each: hours

Writes results/surroundings.csv: one row for each surrounding with the Python, the numbers of tests that passed, failed
and were skipped. What cannot be made on a machine is a row that says why. Environments are kept in build/surroundings.

    as-is          the environment that runs this script
    no-extras      nothing but what pyproject.toml names as dependencies, and pytest
    no-home        HOME is not set, and nothing of XDG
    home-missing   HOME is a folder that does not exist
    no-temp        /tmp, /var/tmp and /usr/tmp cannot be written to
    read-only      the working folder cannot be written to
    no-locale      LC_ALL=C, and Python is kept from taking UTF-8 instead
    lowest         each dependency and extra in the lowest version that pyproject.toml allows
    pythonX.Y      each other Python from 3.11 on that is found, with the newest packages
"""

import argparse
import os
import shutil
import subprocess
import sys
import tomllib
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass, field
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from smallest import build, results, sized
from tables import read_rows, write_rows

ROOT = Path(__file__).resolve().parents[2]
WORK = build("surroundings")
TABLE = results("surroundings.csv")
QUICK = ("tests/core", "tests/page", "tests/test_cli.py", "tests/test_cli_refusals.py", "tests/test_packaging.py",
         "tests/test_missing_extras.py")  # fmt: skip
SMALL = "tests/core/test_record.py"
EXTRAS = ("campaign", "envs", "geometry", "parquet", "teaching")
FOR_TESTS = ("pytest", "hatchling")
TEMPORARY = ("/tmp", "/var/tmp", "/usr/tmp")
NOWHERE = Path("/proc")  # a folder that not even root can write to
OLDEST = 11


class CannotBeMade(Exception):
    """A surrounding that this machine does not give, with the reason."""


@dataclass
class Surrounding:
    """How the tests are run: with which Python, changed variables (None: not set), in which folder, behind what."""

    python: Path
    variables: dict[str, str | None] = field(default_factory=dict)
    folder: Path = ROOT
    before: tuple[str, ...] = ()


def environment(name: str, python: str, packages: list[str], constraints: str = "") -> Path:
    """Return the Python of an environment with the testbench and packages; made, if it is not there or is another."""
    folder = WORK / name
    wanted = "\n".join([python, *packages, constraints])
    made = folder / "made-of"
    if not made.exists() or made.read_text(encoding="utf-8") != wanted:
        shutil.rmtree(folder, ignore_errors=True)
        WORK.mkdir(parents=True, exist_ok=True)
        listed = WORK / f"{name}.txt"
        listed.write_text(constraints, encoding="utf-8")
        for command in (
            [python, "-m", "venv", str(folder)],
            [str(folder / "bin/python"), "-m", "pip", "install", "-c", str(listed), *packages],
        ):
            done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
            if done.returncode:
                lines = (done.stdout + done.stderr).splitlines()
                said = [line.strip() for line in lines if line.startswith(("ERROR", "The conflict", "    "))]
                raise CannotBeMade(f"not installed: {' '.join(said[:9]) or 'no reason given'}")
        made.write_text(wanted, encoding="utf-8")
    return folder / "bin/python"


def lowest() -> str:
    """Return constraints: each dependency and extra in the lowest version that pyproject.toml allows."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    asked = [*project["dependencies"], *(r for e in EXTRAS for r in project["optional-dependencies"][e])]
    return "".join(f"{r.replace('>=', '==')}\n" for r in sorted(set(asked)))


def pythons() -> dict[str, str]:
    """Return the other Pythons of this machine from 3.11 on, by name."""
    found = {}
    for minor in range(OLDEST, 30):
        name = f"python3.{minor}"
        kept = sorted(Path.home().glob(f".pyenv/versions/3.{minor}.*/bin/python"))
        for candidate in (shutil.which(name), *map(str, kept)):
            if candidate is None or (3, minor) == sys.version_info[:2]:
                continue
            if subprocess.run([candidate, "-c", "import venv, ssl"], capture_output=True, check=False).returncode == 0:
                found[name] = candidate
    return found


def all_extras() -> str:
    return f"{ROOT}[{','.join(EXTRAS)}]"


def surrounding(name: str) -> Surrounding:
    """Make one.

    Raises:
        CannotBeMade: not on this machine.
    """
    here = Path(sys.executable)
    if name == "as-is":
        return Surrounding(here)
    if name == "no-extras":
        return Surrounding(environment(name, sys.executable, ["-e", str(ROOT), *FOR_TESTS]))
    if name == "no-home":
        return Surrounding(here, dict.fromkeys(("HOME", "XDG_CACHE_HOME", "XDG_CONFIG_HOME", "XDG_DATA_HOME")))
    if name == "home-missing":
        return Surrounding(here, {"HOME": "/nonexistent/home", "XDG_CACHE_HOME": None, "XDG_CONFIG_HOME": None})
    if name == "no-temp":
        mounts = "; ".join(f"[ ! -d {p} ] || mount -t tmpfs -o ro none {p}" for p in TEMPORARY)
        root = [] if os.geteuid() == 0 else ["--map-root-user"]
        before = ("unshare", *root, "--mount", "sh", "-e", "-c", f'{mounts}; exec "$@"', "sh")
        if (
            shutil.which("unshare") is None
            or subprocess.run([*before, "true"], capture_output=True, check=False).returncode
        ):
            raise CannotBeMade("folders cannot be mounted for one process (unshare --mount)")
        folder = WORK / "no-temp-here"  # what is written for a while goes there, and what a killed process left of it
        folder.mkdir(parents=True, exist_ok=True)
        return Surrounding(here, {"TMPDIR": None, "XDG_CACHE_HOME": None}, folder, before)
    if name == "read-only":
        if not NOWHERE.is_dir():
            raise CannotBeMade(f"{NOWHERE} is not there")
        return Surrounding(here, folder=NOWHERE)
    if name == "no-locale":
        plain = {"LC_ALL": "C", "LANG": None, "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0", "PYTHONIOENCODING": None}
        return Surrounding(here, plain)
    if name == "lowest":
        return Surrounding(environment(name, sys.executable, ["-e", all_extras(), *FOR_TESTS], lowest()))
    return Surrounding(environment(name, pythons()[name], ["-e", all_extras(), *FOR_TESTS]))


def run(name: str, there: Surrounding, tests: list[str]) -> dict[str, object]:
    """Run tests and return the row; what they say goes to build/surroundings/NAME.log."""
    WORK.mkdir(parents=True, exist_ok=True)
    report, log = WORK / f"{name}.xml", WORK / f"{name}.log"
    report.unlink(missing_ok=True)
    variables = {**os.environ, "PYTHONPATH": str(ROOT), "OPENBLAS_NUM_THREADS": "1", "PYTHONDONTWRITEBYTECODE": "1"}
    for key, value in there.variables.items():
        if value is None:
            variables.pop(key, None)
        else:
            variables[key] = value
    command = [
        *there.before, str(there.python), "-m", "pytest", "-m", "not slow", "-p", "no:cacheprovider",
        "-c", str(ROOT / "pyproject.toml"), "--rootdir", str(ROOT), "--basetemp", str(WORK / f"{name}-temp"),
        "--junitxml", str(report), *(str(ROOT / t) for t in tests),
    ]  # fmt: skip
    with log.open("w", encoding="utf-8") as out:
        subprocess.run(command, cwd=there.folder, env=variables, stdout=out, stderr=out, check=False)
    shutil.rmtree(WORK / f"{name}-temp", ignore_errors=True)
    version = subprocess.run(
        [there.python, "-c", "import platform; print(platform.python_version())"],
        capture_output=True,
        text=True,
        check=True,
    ).stdout.strip()
    if not report.exists():
        return {"python": version, "said": f"no test ran: {(log.read_text(errors='replace').splitlines() or [''])[-1]}"}
    suite = ElementTree.parse(report).getroot()[0]
    count = {key: int(suite.get(key, 0)) for key in ("tests", "failures", "errors", "skipped")}
    failed = [
        f"{case.get('classname', '').replace('.', '/')}::{case.get('name')}"
        for case in suite
        if case.find("failure") is not None or case.find("error") is not None
    ]
    lost = count["failures"] + count["errors"]
    return {
        "python": version,
        "passed": count["tests"] - lost - count["skipped"],
        "failed": lost,
        "skipped": count["skipped"],
        "said": "; ".join(failed[:5]),
    }


NAMES = ("as-is", "no-extras", "no-home", "home-missing", "no-temp", "read-only", "no-locale", "lowest")


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--only", nargs="*", default=sized(None, ["as-is"]), help="names of surroundings")
    parser.add_argument("--tests", nargs="*", default=sized([*QUICK], [SMALL]), help="tests to run in each")
    parser.add_argument("--out", type=Path, default=TABLE)
    asked = parser.parse_args()
    columns = ("surrounding", "python", "passed", "failed", "skipped", "said")
    rows: dict[str, dict[str, object]] = {r["surrounding"]: r for r in read_rows(asked.out)}
    names = (*NAMES, *pythons())
    wrong = [name for name in asked.only or () if name not in names]
    if wrong:
        parser.error(f"no surrounding {', '.join(wrong)}; valid: {', '.join(names)}")
    for name in asked.only or names:
        try:
            rows[name] = run(name, surrounding(name), asked.tests)
        except CannotBeMade as error:
            rows[name] = {"said": str(error)}
        rows[name]["surrounding"] = name
        print("  ".join(f"{rows[name].get(c, '')}" for c in columns), flush=True)
        write_rows(asked.out, columns, (rows[n] for n in dict.fromkeys((*names, *sorted(rows))) if n in rows))
    return int(any(str(rows[n].get("failed") or 0) != "0" for n in asked.only or names))


if __name__ == "__main__":
    sys.exit(main())
