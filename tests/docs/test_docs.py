"""The documentation: its links lead somewhere, its commands and code are right, it builds without a warning."""

import importlib
import importlib.util
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from testbench.core.paths import find_scenario
from testbench.effects import EFFECTS

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
MADE = {"gallery.md", "commands.md", "scenarios.md", "questions.md"}
PAGES = sorted(p for p in DOCS.rglob("*.md") if p.name not in MADE and "_" not in p.parent.name[:1])
BLOCK = re.compile(r"^```(\w+)\n(.*?)^```", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"(?<!!)\[[^\]]*\]\(([^)\s]+)\)")


def name(path):
    return str(path.relative_to(DOCS))


def anchors(path):
    """Return the anchors of a page's headings, as the generator makes them."""
    headings = re.findall(r"^#{1,3} (.+)$", path.read_text("utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", h.lower()).strip().replace(" ", "-") for h in headings}


def test_the_overview_counts_the_effects_of_aircraft_and_air():
    said = re.search(r"(\d+) effects of the aircraft", (DOCS / "overview.md").read_text(encoding="utf-8"))
    names = list(EFFECTS)
    of_sensors = names.index("V_bias")  # and all that follow; a clock is an instrument, too
    assert int(said.group(1)) == len([n for n in names[:of_sensors] if n != "clock_offset"])


@pytest.mark.parametrize("page", [*PAGES, ROOT / "README.md"], ids=lambda p: p.stem)
def test_links_lead_somewhere(page):
    lost = []
    for target in LINK.findall(page.read_text("utf-8")):
        if target.startswith(("http://", "https://", "mailto:")):
            continue
        file, _, anchor = target.partition("#")
        there = (page.parent / file).resolve() if file else page
        if there.name in MADE:
            continue  # made by docs/generate.py
        if not there.exists() or (anchor and anchor not in anchors(there)):
            lost.append(target)
    assert not lost


def commands_of(page):
    for language, body in BLOCK.findall(page.read_text("utf-8")):
        if language in ("sh", "console"):
            yield from (line.strip().removeprefix("$ ") for line in body.splitlines())


def test_every_command_of_the_pages_exists_with_its_options():
    from typer.main import get_command

    from testbench.cli import app

    program, wrong, seen = get_command(app), [], 0
    for page in [*PAGES, ROOT / "README.md"]:
        for line in commands_of(page):
            if not line.startswith("testbench "):
                continue
            seen += 1
            words = line.split("#")[0].split()[1:]
            found = program.commands.get(words[0])
            while found is not None and hasattr(found, "commands") and len(words) > 1:
                words = words[1:]
                first = next((found.commands[k] for k in ("show", "draw", "suites") if k in found.commands), None)
                found = found.commands.get(words[0], first)
            if found is None:
                wrong.append(f"{name(page) if page.is_relative_to(DOCS) else page.name}: {line}")
                continue
            options = {o for p in found.params for o in p.opts} | {"--help"}
            wrong += [f"{line}: {w}" for w in words if re.match(r"--?[a-z]", w) and w.split("=")[0] not in options]
            if words[0] in ("run", "design", "plan", "compare") and len(words) > 1 and words[1].isidentifier():
                find_scenario_of(words[0], words[1])
    assert not wrong
    assert seen > 15


def find_scenario_of(command, scenario):
    """Raise ScenarioError if a page names a scenario that there is not."""
    if scenario == "mine":
        return
    folders = {"run": "", "design": "design/", "plan": "plan/", "compare": "compare/"}
    find_scenario(folders[command] + scenario)


ELSEWHERE = ("ask_your_own_question", "export_the_aircraft")
"""Pages whose Python test_guides.py runs: some hundred flights, and packages that need not be there."""


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.stem)
def test_toml_and_python_of_the_pages_are_right(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # what a page writes lies there
    namespace = {}
    for language, body in BLOCK.findall(page.read_text("utf-8")):
        if language == "toml":
            tomllib.loads(body)
        elif language == "python" and page.stem not in ELSEWHERE:
            code = body.replace('"scenarios/', f'"{ROOT.as_posix()}/scenarios/')
            exec(compile(code, name(page), "exec"), namespace)
    assert "result" not in namespace or not namespace["result"].table.empty


def described(text):
    """Yield the names that the directives of a page describe: of a module its members, too."""
    for kind, target, options in re.findall(r"^\.\. auto(\w+):: (\S+)\n((?: +:.*\n)*)", text, re.MULTILINE):
        yield target
        if kind != "module" or ":no-members:" in options:
            continue
        module = importlib.import_module(target)
        left_out = re.search(r":exclude-members: (.*)", options)
        names = getattr(module, "__all__", None) or [
            n for n, v in vars(module).items() if n[:1] != "_" and getattr(v, "__module__", "") == target
        ]
        yield from (f"{target}.{n}" for n in names if not left_out or n not in left_out[1].replace(",", " ").split())


def test_nothing_is_described_twice():
    names = [n for page in sorted(DOCS.rglob("*.md")) for n in described(page.read_text("utf-8"))]
    assert len(names) > 300
    assert sorted({n for n in names if names.count(n) > 1}) == []


@pytest.mark.slow
def test_the_site_builds_without_a_warning(tmp_path):
    if importlib.util.find_spec("sphinx") is None:
        pytest.skip("the site needs the extra docs")
    subprocess.run([sys.executable, "docs/generate.py", "--no-pictures"], cwd=ROOT, check=True)
    done = subprocess.run(
        [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", "-b", "html", "docs", str(tmp_path)],
        cwd=ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    page = (tmp_path / "theory" / "information.html").read_text("utf-8")
    assert "<math" in page
    assert "cdn" not in page
