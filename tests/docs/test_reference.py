"""The reference that is committed is what the program says of itself: `python docs/generate.py --reference`."""

import importlib.util
from pathlib import Path

import pytest

DOCS = Path(__file__).resolve().parents[2] / "docs"
_SPEC = importlib.util.spec_from_file_location("docs_generate", DOCS / "generate.py")
generate = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(generate)


@pytest.mark.parametrize("name", generate.REFERENCE)
def test_the_committed_reference_is_what_the_program_says(name):
    said = generate.REFERENCE[name]()
    assert len(said) > 2000
    assert (DOCS / "reference" / name).read_text(encoding="utf-8") == said, "run `python docs/generate.py --reference`"
