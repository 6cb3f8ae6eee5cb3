"""Seals of a recording: a chain of hashes over its blocks, and how far it went.

A seal is a block like any other, at the entity `seal`: how many blocks stand before it, the chain's value after them,
the hashes of those since the seal before it and, in a finished file, the hash of its index and how many rows every
entity has. It vouches for itself as well: it holds the hash of its own block with that hash's place filled
with zeros. An open recording has a seal after every flush, a finished one has one at its end. Nothing secret is in a
seal: it finds damage, and what was cut out, put in or put elsewhere; who forges one knows what he does.
"""

from __future__ import annotations

import hashlib
import json
import secrets
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from workcell.errors import OutputError

ENTITY, KEY = "seal", "vouches-for-blocks"
"""Where a seal stands, and the key of its JSON, which no other block holds; its value is the version."""

VERSION = 1
_SHORT = 16
_TRIES = 16
_LETTERS = str.maketrans("0123456789abcdef", "ghijklmnopqrstuv")
"""Digits of a block's own hash, of which none can be the length of so short a run of them in a compressed block."""


def digest(block: bytes) -> str:
    """Hash of a block as seals list them."""
    return hashlib.sha256(block).hexdigest()[:_SHORT]


@dataclass(slots=True)
class Chain:
    """The running hash over a file's blocks.

    Attributes:
        value: over all blocks so far, the file's header first.
        blocks: how many.
        listed: their hashes since the last seal.
    """

    value: str
    blocks: int = 0
    listed: list[str] = field(default_factory=list)

    @staticmethod
    def begin(header: bytes) -> Chain:
        """A chain that no block was added to."""
        return Chain(hashlib.sha256(header).hexdigest())

    def add(self, block: bytes) -> None:
        """One more block."""
        whole = hashlib.sha256(block).hexdigest()
        self.value = hashlib.sha256((self.value + whole).encode()).hexdigest()
        self.blocks += 1
        self.listed.append(whole[:_SHORT])

    def sealed(
        self,
        encode: Callable[[str], bytes],
        *,
        index: str | None = None,
        rows: Mapping[str, int] | None = None,
    ) -> bytes:
        """The block of a seal over everything so far, which joins the chain.

        Args:
            encode: a JSON text as a block.
            index: hash of the index of a finished file.
            rows: of every entity of a finished file.
        """
        for _ in range(_TRIES):
            place = secrets.token_hex(32).translate(_LETTERS)
            said = {KEY: VERSION, "blocks": self.blocks, "chain": self.value, "index": index, "rows": rows}
            block = encode(json.dumps({**said, "listed": "".join(self.listed), "own": place}))
            # Random letters that a compressed block holds as they are, nearly always. They come last, so that nothing
            # after them was compressed by what they were before.
            if block.count(place.encode()) == 1 and KEY.encode() in block:
                block = block.replace(place.encode(), _own(block, place).encode())
                self.add(block)
                self.listed.clear()
                return block
        raise OutputError("the recording can't be sealed: Rerun's blocks hide what they hold")


@dataclass(frozen=True, slots=True)
class Seal:
    """What a seal says.

    Attributes:
        blocks: number of blocks before it.
        chain: the chain's value after them.
        listed: hashes of the blocks since the seal before it, in order.
        index: hash of the index, of a finished file.
        rows: of every entity of a finished file.
    """

    blocks: int
    chain: str
    listed: tuple[str, ...]
    index: str | None
    rows: Mapping[str, int]

    @staticmethod
    def of(text: str, block: bytes) -> Seal | None:
        """The seal that a block holds, or None where it isn't one, or not as it was written."""
        try:
            said: dict[str, Any] = json.loads(text)
            own, listed = str(said["own"]), str(said["listed"])
            seal = Seal(
                int(said["blocks"]),
                str(said["chain"]),
                tuple(listed[k : k + _SHORT] for k in range(0, len(listed), _SHORT)),
                None if said["index"] is None else str(said["index"]),
                {str(path): int(count) for path, count in (said["rows"] or {}).items()},
            )
        except (ValueError, KeyError, TypeError, AttributeError):
            return None
        whole = said.get(KEY) == VERSION and block.count(own.encode()) == 1 and _own(block, own) == own
        return seal if whole else None


def _own(block: bytes, place: str) -> str:
    whole = hashlib.sha256(block.replace(place.encode(), b"0" * len(place)))
    return whole.hexdigest().translate(_LETTERS)
