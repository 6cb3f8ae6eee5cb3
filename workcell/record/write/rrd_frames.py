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
_PLACE = struct.Struct("<QQI")
"""Where the index lies, how long it is, and its checksum: before the trailer's last words."""
_TRAILER_BYTES = len(TRAILER) + 4
_END_BYTES = _PLACE.size + _TRAILER_BYTES
_INDEX, STORE_INFO, DATA, ACTIVATION = 0, 1, 2, 3


@dataclass(frozen=True, slots=True)
class Frames:
    """What `.rrd` bytes hold.

    Attributes:
        header: the first 12 bytes.
        frames: (kind, bytes with the frame's own header) of every whole frame but the index.
        indexed: whether an index follows the frames: the file was finished.
        index: the index and the trailer, as far as they are there.
        rest: bytes after the last whole frame that can't be understood.
    """

    header: bytes
    frames: tuple[tuple[int, bytes], ...]
    indexed: bool
    index: bytes
    rest: int

    @property
    def index_alone(self) -> bytes:
        """The index with its checksum, without where it lies."""
        return self.index[:-_END_BYTES] + self.index[-_TRAILER_BYTES - 4 :]

    @property
    def index_placed(self) -> bool:
        """Whether the trailer says where the index lies."""
        if len(self.index) < _FRAME_HEADER.size + _END_BYTES:
            return False
        begins = len(self.header) + sum(len(frame) for _, frame in self.frames) + _FRAME_HEADER.size
        where, length, _ = _PLACE.unpack_from(self.index, len(self.index) - _END_BYTES)
        return bool((where, length) == (begins, len(self.index) - _FRAME_HEADER.size - _END_BYTES))


def split_frames(data: bytes) -> Frames:
    """Takes `.rrd` bytes apart."""
    frames: list[tuple[int, bytes]] = []
    at = HEADER_BYTES
    while at + _FRAME_HEADER.size <= len(data):
        kind, length = _FRAME_HEADER.unpack_from(data, at)
        end = at + _FRAME_HEADER.size + length
        if kind == _INDEX:
            return Frames(data[:HEADER_BYTES], tuple(frames), TRAILER in data[-_TRAILER_BYTES:], data[at:], 0)
        if kind not in (STORE_INFO, DATA, ACTIVATION) or end > len(data):
            break
        frames.append((kind, data[at:end]))
        at = end
    return Frames(data[:HEADER_BYTES], tuple(frames), False, b"", max(len(data) - at, 0))


def with_block(data: bytes, block: bytes) -> bytes:
    """A finished file with one more frame after its last one, which its index doesn't list.

    The trailer says where the index lies, which is further back then.
    """
    whole = split_frames(data)
    at = len(data) - len(whole.index)
    assert whole.index_placed
    where, length, check = _PLACE.unpack_from(data, len(data) - _END_BYTES)
    place = _PLACE.pack(where + len(block), length, check)
    return data[:at] + block + whole.index[:-_END_BYTES] + place + data[-_TRAILER_BYTES:]
