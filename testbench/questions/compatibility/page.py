"""The page on the compatibility of recorded data; the corrected records lie beside it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from testbench.page.labels import file_stem
from testbench.page.page import COMPUTED, Page, source_of
from testbench.page.words import Line, sentence
from testbench.questions.compatibility.answer import compatibility_answer
from testbench.questions.compatibility.figures import Records, compatibility_plates
from testbench.questions.compatibility.tables import compatibility_tables, fault_table
from testbench.questions.identify.instruments import agreement_in_words

if TYPE_CHECKING:
    from testbench.estimators.data_compatibility import DataCompatibility
    from testbench.inference.instruments import Agreement
    from testbench.questions.identify.scenario import RecordDescription


def compatibility_page(
    result: DataCompatibility | None,
    records: Records,
    description: RecordDescription,
    questions: Sequence[str] = (),
    agreed: Agreement | None = None,
) -> Page:
    """Return the page of a check of the instruments, with records/NAME_corrected.nc.

    ``result`` is None where the records hold too few channels for every error to be estimated. ``questions`` are values
    of the records that are hardly meant, in words. ``agreed`` says which instrument to look at first.
    """
    from testbench.estimators.data_compatibility import correct

    tables = [
        *([] if agreed is None else [fault_table(agreed)]),
        *([] if result is None else compatibility_tables(result)),
    ]
    lines = [] if result is None else compatibility_answer(result)
    if agreed is not None:
        first = [Line("finding" if k else "lead", sentence(text)) for k, text in enumerate(agreement_in_words(agreed))]
        more = [line._replace(kind="finding") if line.kind == "lead" else line for line in lines]
        lines = [*first, *([] if agreed.contradicted else more)]  # errors that are all sought at once share a large one
    return Page(
        kicker=f"Data compatibility: {description.name}",
        title=description.title,
        answer=[*lines, *(("doubt", text) for text in questions)],
        tables=tables,
        plates=[] if result is None else compatibility_plates(result, records),
        files={}
        if result is None
        else {f"records/{file_stem(n)}_corrected.nc": correct(r, result).save for n, r in records.items()},
        packages=COMPUTED,
        source=source_of(description),
        terminal=[t.without("words") for t in tables[:1]],
    )
