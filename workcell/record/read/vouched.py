"""Which blocks of a recording are as they were written, by the seals that stand in it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from workcell.record.write.rrd_frames import DATA, Frames
from workcell.record.write.seal import KEY, Chain, Seal, digest

Block = tuple[int, bytes]
"""A frame's kind and its bytes."""


@dataclass(frozen=True, slots=True)
class Vouched:
    """The blocks of a recording, by what its seals say of them.

    Attributes:
        sealed: whether there is a seal that is as it was written.
        finished: whether the last one closes the file.
        good: the blocks that are as they were written, without the seals.
        unknown: those that no seal says anything about.
        damage: what is not as it was written, in words.
        rows: of every entity, as a finished file's seal says.
    """

    sealed: bool
    finished: bool
    good: tuple[Block, ...]
    unknown: tuple[Block, ...]
    damage: tuple[str, ...]
    rows: Mapping[str, int]


def may_be_seal(block: Block) -> bool:
    """Whether a block holds the words that only seals hold."""
    return block[0] == DATA and KEY.encode() in block[1]


def vouched(whole: Frames, texts: Sequence[str | None]) -> Vouched:
    """Goes through a file's blocks, from seal to seal.

    Args:
        whole: the file, taken apart.
        texts: of the blocks that may be seals, in order; None where it can't be read.
    """
    chain, left = Chain.begin(whole.header), iter(texts)
    good: list[Block] = []
    waiting: list[Block] = []
    unknown: list[Block] = []
    damage: list[str] = []
    last: Seal | None = None
    for k, block in enumerate(whole.frames):
        if not may_be_seal(block):
            waiting.append(block)
            continue
        text = next(left)
        seal = None if text is None else Seal.of(text, block[1])
        if seal is None:
            damage.append("a seal is damaged")
            continue
        damage += _differences(chain, waiting, seal)
        listed, others = _listed(waiting, seal)
        good += listed
        if len(others) > len(seal.listed) - len(listed):
            unknown += others  # more than were damaged: a seal before this one is gone
        chain = Chain(seal.chain, seal.blocks)
        chain.add(block[1])
        waiting, last = [], seal
        if seal.index is not None:
            damage += _after_the_end(whole, k, seal.index)
            break
    finished = last is not None and last.index is not None
    return Vouched(
        last is not None,
        finished,
        tuple(good),
        (*unknown, *waiting),
        tuple(damage),
        last.rows if last else {},
    )


def _differences(chain: Chain, waiting: Sequence[Block], seal: Seal) -> list[str]:
    """How the blocks before a seal differ from those that it was set under."""
    for _, block in waiting:
        chain.add(block)
    if (chain.value, chain.blocks) == (seal.chain, seal.blocks):
        return []
    lost = Counter(seal.listed) - Counter(chain.listed)
    strange = Counter(chain.listed) - Counter(seal.listed)
    words = []
    if lost:
        words.append(f"{lost.total()} of {len(seal.listed)} blocks are damaged or missing")
    if strange.total() > lost.total():
        words.append(f"{strange.total() - lost.total()} blocks are there that no seal lists")
    return words or ["its blocks are not in the order in which they were written, or its header is damaged"]


def _listed(waiting: Sequence[Block], seal: Seal) -> tuple[list[Block], list[Block]]:
    """Those of the blocks that the seal lists, and the others."""
    left, found, others = Counter(seal.listed), list[Block](), list[Block]()
    for block in waiting:
        short = digest(block[1])
        (found if left[short] > 0 else others).append(block)
        left[short] -= 1
    return found, others


def _after_the_end(whole: Frames, at: int, index: str) -> list[str]:
    """What is wrong behind the last seal of a finished file."""
    words = []
    if extra := len(whole.frames) - 1 - at:
        words.append(f"{extra} blocks were added after its end")
    if digest(whole.index_alone) != index or not whole.index_placed:
        words.append("its index is damaged or cut off")
    return words
