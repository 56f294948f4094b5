"""The page on the compatibility of recorded data; the corrected records lie beside it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from testbench.page.labels import file_stem
from testbench.page.page import COMPUTED, Page, source_of
from testbench.questions.compatibility.answer import compatibility_answer
from testbench.questions.compatibility.figures import Records, compatibility_plates
from testbench.questions.compatibility.tables import compatibility_tables

if TYPE_CHECKING:
    from testbench.estimators.data_compatibility import DataCompatibility
    from testbench.questions.identify.scenario import RecordDescription


def compatibility_page(
    result: DataCompatibility, records: Records, description: RecordDescription, questions: Sequence[str] = ()
) -> Page:
    """Return the page of a check of the instruments, with records/NAME_corrected.nc.

    ``questions`` are values of the records that are hardly meant, in words.
    """
    from testbench.estimators.data_compatibility import correct

    tables = compatibility_tables(result)
    return Page(
        kicker=f"Data compatibility: {description.name}",
        title=description.title,
        answer=[*compatibility_answer(result), *(("doubt", text) for text in questions)],
        tables=tables,
        plates=compatibility_plates(result, records),
        files={f"records/{file_stem(n)}_corrected.nc": correct(r, result).save for n, r in records.items()},
        packages=COMPUTED,
        source=source_of(description),
        terminal=[t.without("words") for t in tables[:1]],
    )
