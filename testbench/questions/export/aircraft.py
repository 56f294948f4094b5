"""An aircraft for other programs: as C, as a unit for co-simulation, and as plain JSBSim XML."""

from __future__ import annotations

import hashlib
import io
import platform
import shutil
import subprocess
import sys
import warnings
import zipfile
from collections.abc import Mapping
from pathlib import Path

from testbench import __version__
from testbench.aircraft import Aircraft
from testbench.core.constants import DEG_RAD
from testbench.core.errors import LimitError, brief, nearest
from testbench.core.escape import c_identifier, c_string, markdown_cell, one_line, xml_attribute
from testbench.core.files import Scratch, write_file
from testbench.core.named import Named, obtain
from testbench.core.store import ResultFolder, folder_in
from testbench.flight import FlightCondition, trim
from testbench.flight.batch.alone import Alone, Signal, alone
from testbench.flight.batch.c99 import about, c_files, c_number, provenance
from testbench.flight.executive import Executive

_HERE = Path(__file__).parent
_EXPONENTS: Mapping[str, Mapping[str, int]] = {
    "1": {}, "1/s": {"s": -1}, "1/s2": {"s": -2}, "rad": {"rad": 1}, "rad/s": {"rad": 1, "s": -1},
    "rad/s2": {"rad": 1, "s": -2}, "m": {"m": 1}, "m/s": {"m": 1, "s": -1}, "m/s2": {"m": 1, "s": -2},
    "N": {"kg": 1, "m": 1, "s": -2}, "Pa": {"kg": 1, "m": -1, "s": -2},
}  # fmt: skip
"""SI unit of the table of channels -> exponents of the base units that FMI knows."""
_PLACES = {
    2: {("linux", "x86_64"): "linux64", ("darwin", "x86_64"): "darwin64"},
    3: {
        ("linux", "x86_64"): "x86_64-linux",
        ("linux", "aarch64"): "aarch64-linux",
        ("darwin", "x86_64"): "x86_64-darwin",
        ("darwin", "arm64"): "aarch64-darwin",
    },
}
"""Version of FMI -> system and processor -> the folder of a library; FMI 2.0 names none for other processors."""
_COMPILERS = ("cc", "gcc", "clang")
_FLAGS = ("-std=c99", "-O2", "-fPIC", "-shared", "-fvisibility=hidden", "-ffp-contract=off")
_START = (
    ("h", "m", "height above sea level"), ("phi", "rad", "bank angle"), ("theta", "rad", "pitch angle"),
    ("psi", "rad", "heading"), ("u", "m/s", "velocity over ground along body x"),
    ("v", "m/s", "velocity over ground along body y"), ("w", "m/s", "velocity over ground along body z"),
    ("p", "rad/s", "roll rate"), ("q", "rad/s", "pitch rate"), ("r", "rad/s", "yaw rate"),
)  # fmt: skip
_STOP_S = 20.0
TARGETS = ("c", "fmu2", "fmu3", "jsbsim")
"""What an aircraft is written as."""


def export_aircraft(
    aircraft: Named[Aircraft], to: str, folder: Path | str = "exports", condition: FlightCondition | None = None
) -> list[Path]:
    """Write an aircraft for other programs into a folder of its own in ``folder`` and return the paths.

    Args:
        aircraft: what is written; its folder has its name.
        to: "c" NAME.h and NAME.c, which fly from the trim; "fmu2", "fmu3" a unit for co-simulation by FMI 2.0 or 3.0,
            which does the same; "jsbsim" NAME.xml, Engines/ and README.md, a model that stock JSBSim loads from
            ``folder``: nothing is flown for it, so that an aircraft that does not trim can be looked at elsewhere.
        folder: in which it is written.
        condition: where it is trimmed, and for which the elastic equations are made; the design condition if not given.

    Raises:
        LimitError: it is not found equal to JSBSim in a batch, of which C and units are made.
        TrimError: it has no trim there.
        BusyError: another process writes into the folder.
        WriteError: the folder cannot be written to, or has such a file that the testbench did not write.

    Example:
        >>> import tempfile
        >>> import testbench as tb
        >>> [path.name for path in tb.export_aircraft("taurus", "c", tempfile.mkdtemp())]
        ['taurus.h', 'taurus.c']
    """
    if to not in TARGETS:
        raise LimitError(f"an aircraft goes to one of {', '.join(TARGETS)}, got '{to}'{nearest(to, TARGETS)}")
    aircraft = obtain(Aircraft, aircraft)
    condition = condition or FlightCondition(aircraft.design_V_m_s, aircraft.design_h_m)
    name = aircraft.name.removesuffix(", rigid wings")
    files: dict[str, str | bytes]
    if to == "jsbsim":
        files = dict(_plain(aircraft, name, condition))
    else:
        model, stem = alone(aircraft, trim(aircraft, condition)), c_identifier(name)
        if to == "c":
            files = dict(zip((f"{stem}.h", f"{stem}.c"), c_files(model, name), strict=True))
        else:
            files = {f"{stem}_{to}.fmu": fmu(model, name, int(to[-1]))}
    with ResultFolder(folder_in(Path(folder), name), adds=True) as place:
        for file, content in files.items():
            place.check(file)
            write_file(place.new / file, content)
    return [place.path / file for file in files]


def _plain(aircraft: Aircraft, name: str, condition: FlightCondition) -> dict[str, str]:
    """Return the files of a plain model.

    The elastic equations are made for the condition and the aircraft's own frame rate. Of a foreign model README.md
    says how it is commanded and what it must be told.
    """
    rate = aircraft.rate_hz
    note = (
        f"# {markdown_cell(name)}\n\n{markdown_cell(aircraft.title)}. Plain JSBSim model, for the `aircraft/` folder "
        "of a JSBSim root directory.\n\n"
    )
    if aircraft.flown_modes() is not None:
        note += (
            f"The elastic equations are made for {rate:g} frames per second: set the frame time to 1/{rate:g} s before "
            f"the model is loaded, as any other gives wrong modes. They are exact at {condition}, and close at other "
            "speeds.\n"
        )
    else:
        note += f"The model has no elastic equations and flies at any frame rate; {rate:g} per second is its own.\n"
    return {
        f"{name}.xml": aircraft.model_xml(rate, condition.qbar_Pa, condition.V_m_s),
        **{f"Engines/{file}": text for file, text in aircraft.engine_files.items()},
        "README.md": note + _commands(aircraft, condition),
    }


def _commands(aircraft: Aircraft, condition: FlightCondition) -> str:
    """Return how a foreign model is commanded and what it must be told before it flies; empty for one of our form."""
    if aircraft.adapter is None:
        return ""
    rows = [f"- {c.name}: `{c.command}`, {'0 to 1' if c.name == 'thr' else 'rad'}" for c in aircraft.controls.values()]
    told = [f"- `{name}` = {value:g}" for name, value in aircraft.adapter.settings.items()]
    fdm = Executive(aircraft, aircraft.rate_hz, condition)
    pistons = fdm.has("propulsion/engine/map-pa")
    running = [f"- `{name}` = {value:.9g}" for name, value in fdm.leaned().items() if pistons]
    note = (
        "\nIts controls are commanded through these properties:\n\n" + "\n".join(rows) + "\n\nSet once it is loaded, "
        "before its engines are started (`propulsion/set-running` = -1):\n\n" + "\n".join(told) + "\n"
    )
    if running:
        leaned = f"\nSet once they run, as starting makes the mixture full rich; leaned for {condition.h_m:g} m:\n\n"
        note += leaned + "\n".join(running) + "\n"
    return note


# --- FMUs -------------------------------------------------------------------------------------------------------------


def fmu(model: Alone, name: str, version: int) -> bytes:
    """Return a unit, an archive: modelDescription.xml, sources/ and, where there is a compiler, binaries/.

    Args:
        model: what flies.
        name: of the unit.
        version: of FMI, 2 or 3.
    """
    stem = c_identifier(name)
    header, source = c_files(model, name)
    start = model.at_trim()
    wrapper = "\n".join([
        *about(model), f'#include "{stem}.h"', f"#define MODEL(name) {stem}_##name",
        f"#define N_INPUTS {len(model.inputs)}", f"#define N_OUTPUTS {len(model.outputs)}",
        f"#define DT {c_number(model.dt_s)}",
        f"static const double START[10] = {{{', '.join(map(c_number, start))}}};",
    ])  # fmt: skip
    parts = [header, source, wrapper, *((_HERE / x).read_text("utf-8") for x in ("fmi.h", f"fmi{version}.c"))]
    token = f"{{{hashlib.sha256(''.join(parts).encode()).hexdigest()[:32]}}}"
    wrapper += f"\n#define TOKEN {c_string(token)}\n"
    files = {
        f"sources/{stem}.h": header, f"sources/{stem}.c": source, "sources/fmi.h": parts[3],
        f"sources/fmi{version}.c": wrapper + parts[4],
        "documentation/licenses/license.txt": "\n".join([*map(one_line, provenance(model.aircraft)), ""]),
        "modelDescription.xml": "\n".join(_description(model, name, stem, token, version, start)),
    }  # fmt: skip
    if version == 3:
        files["sources/buildDescription.xml"] = "\n".join([
            '<?xml version="1.0" encoding="UTF-8"?>', '<fmiBuildDescription fmiVersion="3.0">',
            f"  <BuildConfiguration modelIdentifier={xml_attribute(stem)}>", '    <SourceFileSet language="C99">',
            '      <SourceFile name="fmi3.c"/>', f"      <SourceFile name={xml_attribute(f'{stem}.c')}/>",
            "    </SourceFileSet>", "  </BuildConfiguration>", "</fmiBuildDescription>", "",
        ])  # fmt: skip
    packed = {place: text.encode() for place, text in files.items()}
    packed |= _library(packed, stem, version)
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for place, content in sorted(packed.items()):
            archive.writestr(zipfile.ZipInfo(place), content, zipfile.ZIP_DEFLATED)  # the same bytes at any time
    return out.getvalue()


class SourceOnly(UserWarning):
    """A unit holds no library, only its source; commands print this as a note."""


def _library(files: Mapping[str, bytes], stem: str, version: int) -> dict[str, bytes]:
    """Return the compiled unit at its place; nothing, and a note, where it cannot be compiled."""
    place = _PLACES[version].get((sys.platform, platform.machine()))
    compiler = next((found for name in _COMPILERS if (found := shutil.which(name))), None)
    name = f"{stem}.{'dylib' if sys.platform == 'darwin' else 'so'}"
    reason = f"FMI {version}.0 names no folder for {platform.machine()}" if place is None else "no C compiler is found"
    if place is not None and compiler is not None:
        scratch = Scratch()
        for path, content in files.items():
            if path.startswith("sources/"):
                write_file(Path(scratch.name) / path.removeprefix("sources/"), content)
        words = [compiler, *_FLAGS, f"fmi{version}.c", f"{stem}.c", "-o", name, "-lm"]
        done = subprocess.run(words, cwd=scratch.name, capture_output=True, check=False)
        made = Path(scratch.name) / name
        if done.returncode == 0 and made.is_file():
            return {f"binaries/{place}/{name}": made.read_bytes()}
        reason = f"{compiler} failed: {brief(done.stderr.decode(errors='replace'))}"
    warnings.warn(f"the unit holds its source alone, as {reason}", SourceOnly, stacklevel=2)
    return {}


def _description(model: Alone, name: str, stem: str, token: str, version: int, start: tuple[float, ...]) -> list[str]:
    at, dt = model.trimmed.condition, repr(model.dt_s)
    words = f"{model.aircraft.title}; from a trim at {at}"
    whose = " ".join(provenance(model.aircraft))
    token_is, state = ("guid", "FMUstate") if version == 2 else ("instantiationToken", "FMUState")
    fixed = "" if version == 2 else f' fixedInternalStepSize="{dt}"'
    parameters = [
        Signal(f"{n}_start", unit, f"{text} where the flight begins", 0, 1.0, x)
        for (n, unit, text), x in zip(_START, start, strict=True)
    ]
    variables = [
        *((x, "input", "") for x in model.inputs),
        *((x, "output", ' initial="calculated"') for x in model.outputs),
        *((x, "parameter", ' initial="exact"') for x in parameters),
    ]
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        f'<fmiModelDescription fmiVersion="{version}.0" modelName={xml_attribute(name)} '
        f"{token_is}={xml_attribute(token)}",
        f"    description={xml_attribute(words)}",
        f"    license={xml_attribute(whose)}",
        f'    generationTool={xml_attribute(f"flight-testbench {__version__}")} variableNamingConvention="flat">',
        f'  <CoSimulation modelIdentifier={xml_attribute(stem)} canHandleVariableCommunicationStepSize="true"{fixed}',
        f'      canGetAndSet{state}="true" canSerialize{state}="true"{"/" if version == 3 else ""}>',
    ]
    if version == 2:
        sources = ("fmi2.c", f"{stem}.c")
        lines += ["    <SourceFiles>", *(f"      <File name={xml_attribute(x)}/>" for x in sources)]
        lines += ["    </SourceFiles>", "  </CoSimulation>"]
    lines.append("  <UnitDefinitions>")
    for unit in sorted({x.unit for x, _, _ in variables}):
        base = "".join(f' {of}="{n}"' for of, n in _EXPONENTS[unit].items())
        shown = unit.replace("rad", "deg")
        degrees = f'<DisplayUnit name="{shown}" factor="{1.0 / DEG_RAD!r}"/>' if "rad" in unit else ""
        lines.append(f'    <Unit name="{unit}"><BaseUnit{base}/>{degrees}</Unit>')
    lines += ["  </UnitDefinitions>", f'  <DefaultExperiment startTime="0" stopTime="{_STOP_S}" stepSize="{dt}"/>']
    lines.append("  <ModelVariables>")
    lines += [_variable(k, x, causality, initial, version) for k, (x, causality, initial) in enumerate(variables)]
    if version == 3:
        time = f'valueReference="{len(variables)}" causality="independent" variability="continuous"'
        lines.append(f'    <Float64 name="time" {time} description="time, s"/>')
    lines += ["  </ModelVariables>", "  <ModelStructure>"]
    first = len(model.inputs)
    numbers = range(first, first + len(model.outputs))
    # what an input does shows after a step: a loop through the unit is no algebraic one
    if version == 2:  # which counts variables from one
        lines += [
            "    <Outputs>",
            *(f'      <Unknown index="{k + 1}" dependencies=""/>' for k in numbers),
            "    </Outputs>",
        ]
        unknowns = (f'      <Unknown index="{k + 1}"/>' for k in numbers)
        lines += ["    <InitialUnknowns>", *unknowns, "    </InitialUnknowns>"]
    else:
        lines += [f'    <Output valueReference="{k}" dependencies=""/>' for k in numbers]
        lines += [f'    <InitialUnknown valueReference="{k}"/>' for k in numbers]
    return [*lines, "  </ModelStructure>", "</fmiModelDescription>", ""]


def _variable(reference: int, x: Signal, causality: str, initial: str, version: int) -> str:
    """Return a variable."""
    varies = "fixed" if causality == "parameter" else "continuous"
    head = f'name={xml_attribute(x.name)} valueReference="{reference}" causality="{causality}" variability="{varies}"'
    head += f"{initial} description={xml_attribute(x.description)}"
    shown = f' displayUnit="{x.unit.replace("rad", "deg")}"' if "rad" in x.unit else ""
    real = f'unit="{x.unit}"{shown}'
    if causality == "input":
        real += f' min="{x.low!r}" max="{x.high!r}"'
    if causality != "output":
        real += f' start="{x.at_trim!r}"'
    if version == 2:
        return f"    <ScalarVariable {head}><Real {real}/></ScalarVariable>"
    return f"    <Float64 {head} {real}/>"
