"""Damaged files of every format end in a sentence or a result: no other exception, no hang, no gigabyte.

What holds for the first cases of each format holds for many: ``make fuzz`` runs 2000 of each.

Each kind of file that the door knows has an example, which is damaged: a new kind cannot escape.
"""

import os
import re
import zlib
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path

import numpy as np
import pytest
from fuzz import inputs
from fuzz.kinds import examples
from fuzz.mutations import damaged, mistyped, of_text
from fuzz.survive import broken

import testbench
from testbench.core.door import KINDS
from testbench.core.errors import TestbenchError
from testbench.questions.export.ask import export_model, export_record, load_matrices
from testbench.questions.files import WITH_FILES, file_classes
from testbench.questions.importing.ask import import_log, write_import

SEEDS = int(os.environ.get("FUZZ_SEEDS", "0"))
FEW = 6  # of each format in the normal suite
TEXTS = ("csv", "text", "dataflash text")
WRITTEN = 6  # of so many that are read, one is written as well: that takes longer


def rng_of(name: str, seed: int) -> np.random.Generator:
    return np.random.default_rng([zlib.crc32(name.encode()), seed])


def seeds(few: int) -> range:
    return range(SEEDS or few)


def imported(content: bytes, suffix: str, name: str, seed: int, folder: Path) -> None:
    damage = of_text if name in TEXTS else damaged
    path = folder / f"log{suffix}"
    path.write_bytes(damage(content, rng_of(name, seed)))
    found = import_log(path)
    assert found.record.kind == "measured"
    if seed % WRITTEN == 0:
        write_import(found, folder / "out")


@pytest.fixture(scope="module")
def formats(tmp_path_factory):
    return inputs.logs(tmp_path_factory.mktemp("valid"))


NAMES = (
    "csv", "text", "mat 5", "mat 5 packed", "mat of the testbench", "mat 7.3", "record", "netcdf 4", "netcdf classic",
    "ulog", "dataflash", "dataflash text", "parquet",
)  # fmt: skip


@pytest.mark.parametrize("name", NAMES)
def test_damaged_logs(name, formats, tmp_path):
    if name not in formats:
        pytest.skip("pyarrow is missing: pip install flight-testbench[parquet]")
    suffix, content = formats[name]
    (tmp_path / f"valid{suffix}").write_bytes(content)
    assert import_log(tmp_path / f"valid{suffix}").channels  # what is damaged is a valid file
    cases = {f"{name} {seed}": partial(imported, content, suffix, name, seed) for seed in seeds(FEW)}
    assert broken(cases) == []


def test_damaged_messages_and_definitions_of_paparazzi():
    data, definitions = inputs.paparazzi()

    def case(seed: int, folder: Path) -> None:
        rng = rng_of("paparazzi", seed)
        which = seed % 2
        (folder / "f.data").write_bytes(of_text(data.encode(), rng) if which else data.encode())
        (folder / "f.log").write_bytes(definitions.encode() if which else of_text(definitions.encode(), rng))
        import_log(folder / "f.data")

    assert broken({f"paparazzi {seed}": partial(case, seed) for seed in seeds(FEW)}) == []


def test_damaged_records_and_models_to_export(formats):
    def of_record(seed: int, folder: Path) -> None:
        path = folder / "r.nc"
        path.write_bytes(damaged(formats["record"][1], rng_of("export", seed)))
        export_record(path, ("csv", "mat", "netcdf")[seed % 3], folder / "out")

    def of_model(seed: int, folder: Path) -> None:
        rng = rng_of("model", seed)
        path = folder / "m.json"
        path.write_bytes(of_text(inputs.model(), rng))
        export_model(load_matrices(path), ("control", "csv", "json", "jsbsim", "mat", "netcdf")[seed % 6], folder / "o")

    cases: dict[str, Callable[[Path], object]] = {}
    for seed in seeds(FEW):
        cases |= {f"record {seed}": partial(of_record, seed), f"model {seed}": partial(of_model, seed)}
    assert broken(cases) == []


@cache
def texts() -> dict[str, str]:
    return inputs.scenarios()


def checked(name: str, seed: int, folder: Path) -> None:
    inputs.read_scenario(name, mistyped(texts()[name], rng_of(name, seed)), folder)


def test_each_scenario_is_read_by_the_reader_of_its_kind(tmp_path):
    faults = {}
    for name, text in texts().items():
        try:
            inputs.read_scenario(name, text, tmp_path)
        except TestbenchError as error:
            faults[name] = error.message
    assert faults == {}


def test_mistyped_scenarios_of_every_kind():
    names = list(texts())
    cases = {f"{name} {seed}": partial(checked, name, seed) for seed in seeds(2) for name in names}
    assert len(cases) > 100
    assert broken(cases) == []


FEW_OF_A_KIND = 4  # of each kind in the normal suite


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    return tmp_path_factory.mktemp("valid")


def test_every_kind_has_an_example_that_is_read(place, tmp_path):
    found = examples(place)
    assert found.keys() == KINDS.keys()
    for number, example in enumerate(found.values()):
        folder = tmp_path / str(number)
        folder.mkdir()
        assert example.tried(example.content, folder) is not None, example.name


def test_every_class_of_keys_that_files_have_is_of_a_kind_that_is_damaged_and_checked():
    """A class that a file is parsed by stands in the table of the schemas; each kind of it is damaged here."""
    brought = file_classes().keys() - {question.kind for question in WITH_FILES} - {"sensor of a suite"}
    assert brought <= KINDS.keys()
    known = {found.__name__ for found in file_classes().values()} | {"Card", "Cleared"}  # the testbench wrote those
    package = Path(testbench.__file__).parent
    read = re.compile(r"\bparse\((\w+), (?:read_|content|given|found)[^\n]*, (?!None)\w+\)")
    used = {name for path in package.rglob("*.py") for name in read.findall(path.read_text(encoding="utf-8"))}
    assert len(used) > 8
    assert used <= known


def mutant(example, kind, seed):
    """Return the damaged content of an example: bytes, values of another kind, or text."""
    rng = rng_of(kind, seed)
    if kind in ("agent", "campaign store", "record"):
        return damaged(example.content, rng)
    if example.name.endswith(".toml") and seed % 3:
        return mistyped(example.content.decode(), rng).encode("utf-8", "surrogateescape")
    return of_text(example.content, rng)


def test_damaged_files_of_every_kind(place):
    def case(kind, seed, folder):
        example = examples(place)[kind]
        example.tried(mutant(example, kind, seed), folder)

    examples(place)
    cases = {f"{kind} {seed}": partial(case, kind, seed) for seed in seeds(FEW_OF_A_KIND) for kind in KINDS}
    assert broken(cases) == []
