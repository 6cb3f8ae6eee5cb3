"""What a checker made of forgeries."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from workcell.bench.rows import Row


@dataclass(slots=True)
class Tally:
    """What a checker made of one kind's forgeries.

    How many were handed in, accepted, ended in an error that is no answer; seconds; the first that did either.
    """

    tried: int = 0
    accepted: int = 0
    errors: int = 0
    spent: float = 0.0
    first: str = ""

    def hand_in(self, where: str, text: str, checker: Callable[[Any, str], str | None], problem: Any) -> None:
        """Hand in one text for a problem; `where` says which it is."""
        started = time.process_time()
        try:
            if checker(problem, text) is None:
                self.accepted += 1
                self.first = self.first or where + text[:2000]
        except Exception as error:  # whatever it is, it is no answer
            self.errors += 1
            self.first = self.first or where + repr(error)
        self.spent += time.process_time() - started
        self.tried += 1

    def row(self, name: str) -> Row:
        """The tally as a bench's row."""
        return {
            "row": name,
            "n": self.tried,
            "accepted": self.accepted,
            "errors": self.errors,
            "cpu_ms": 1e3 * self.spent / max(self.tried, 1),
            "first": self.first,
        }
