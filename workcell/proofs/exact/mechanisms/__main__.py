"""`python -m workcell.proofs.exact.mechanisms QUESTION CERTIFICATE`: the second checker, of mechanisms."""

from __future__ import annotations

import sys
from pathlib import Path

from workcell.proofs.exact.mechanisms.check import check
from workcell.proofs.exact.reading import MOST_BYTES, RefusedError, parse, read_text

USAGE = "usage: python -m workcell.proofs.exact.mechanisms QUESTION.json CERTIFICATE.json"


def main(arguments: list[str]) -> int:
    """0: the certificate holds. 1: it was refused. 2: wrong usage."""
    if len(arguments) != 2:
        print(USAGE, file=sys.stderr)
        return 2
    try:
        question, certificate = (parse(read_text(Path(name), MOST_BYTES)) for name in arguments)
        print(f"holds: {check(question, certificate)}")
    except RefusedError as refusal:
        text = str(refusal)
        print(f"refused: {''.join(c if c.isprintable() else ascii(c)[1:-1] for c in text)}")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
