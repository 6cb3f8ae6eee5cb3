"""The framing of `.rrd` files: a header of 12 bytes (`RRF2`, version, options), then frames, then an index.

A frame is its kind and its length (8 bytes each, little endian) and a payload; a frame of kind 0 holds the index,
and a trailer that ends in `RRF2FOOT` and a number says where it lies. A file without an index is read frame by frame.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

MAGIC, TRAILER = b"RRF2", b"RRF2FOOT"
HEADER_BYTES = 12

_FRAME_HEADER = struct.Struct("<QQ")
_TRAILER_BYTES = len(TRAILER) + 4
_INDEX, STORE_INFO, DATA, ACTIVATION = 0, 1, 2, 3


@dataclass(frozen=True, slots=True)
class Frames:
    """What `.rrd` bytes hold.

    Attributes:
        header: the first 12 bytes.
        frames: (kind, bytes with the frame's own header) of every whole frame but the index.
        indexed: whether an index follows the frames: the file was finished.
        rest: bytes after the last whole frame that can't be understood.
    """

    header: bytes
    frames: tuple[tuple[int, bytes], ...]
    indexed: bool
    rest: int


def split_frames(data: bytes) -> Frames:
    """Takes `.rrd` bytes apart."""
    frames: list[tuple[int, bytes]] = []
    at = HEADER_BYTES
    while at + _FRAME_HEADER.size <= len(data):
        kind, length = _FRAME_HEADER.unpack_from(data, at)
        end = at + _FRAME_HEADER.size + length
        if kind == _INDEX:
            return Frames(data[:HEADER_BYTES], tuple(frames), TRAILER in data[-_TRAILER_BYTES:], 0)
        if kind not in (STORE_INFO, DATA, ACTIVATION) or end > len(data):
            break
        frames.append((kind, data[at:end]))
        at = end
    return Frames(data[:HEADER_BYTES], tuple(frames), False, max(len(data) - at, 0))
