"""What the second checker says of a file of answers: both have to accept, and a disagreement is named."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from workcell.errors import InputError
from workcell.proofs.exact.reading import RefusedError
from workcell.proofs.exact.verdicts import Verdict, judge_answers


def second_opinions(
    set_file: Path, answers: Path, *, trees: bool, progress: Callable[[], object] | None = None
) -> dict[str, Verdict]:
    """Verdicts of the exact checker, which reads both files itself, by the problems' ids.

    Args:
        set_file: a problem set.
        answers: JSON lines.
        trees: whether proofs by branch and bound are checked too: some hundred milliseconds each.
        progress: called after every line.

    Raises:
        InputError: it can't read one of the files.
    """
    found: dict[str, Verdict] = {}
    try:
        for verdict in judge_answers(set_file, answers, trees=trees):
            found.setdefault(verdict.id, verdict)
            if progress is not None:
                progress()
    except RefusedError as refusal:
        raise InputError(f"the exact checker can't read it: {refusal}", where=set_file) from None
    return found
