"""`python -m workcell.proofs.exact SET ANSWERS`: the second checker alone."""

from __future__ import annotations

import sys
from collections import Counter
from pathlib import Path

from workcell.proofs.exact.reading import RefusedError
from workcell.proofs.exact.verdicts import judge_answers

USAGE = "usage: python -m workcell.proofs.exact SET.json ANSWERS.jsonl"


def main(arguments: list[str]) -> int:
    """0: everything holds. 1: something was refused. 2: a file can't be read."""
    if len(arguments) != 2:
        print(USAGE, file=sys.stderr)
        return 2
    counts = Counter[str]()
    try:
        for verdict in judge_answers(Path(arguments[0]), Path(arguments[1])):
            if verdict.refusal is not None:
                counts["refused"] += 1
                print(_plain(f"refused: line {verdict.line}, {verdict.id}: {verdict.refusal}"))
            else:
                counts[verdict.status] += 1
    except RefusedError as refusal:
        print(_plain(f"error: {refusal}"), file=sys.stderr)
        return 2
    print(", ".join(f"{count} {name}" for name, count in counts.items()) or "no answers")
    return 1 if counts["refused"] else 0


def _plain(text: str) -> str:
    """A text that every terminal takes, whatever stands in a file."""
    return "".join(letter if letter.isprintable() else ascii(letter)[1:-1] for letter in text)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
