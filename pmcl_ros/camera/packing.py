"""The F01's 12-bit packing: two pixels in three bytes, big-endian (lytro_f01.md, B2)."""

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.runtime.errors import CameraError
from pmcl_ros.runtime.kernels import compiled, rounds

_PAIRS = 4096  # that one task unpacks


def unpack12(data: bytes, width: int, height: int) -> NDArray[np.uint16]:
    """Counts (height, width) uint16 of packed bytes.

    Raises CameraError when there are more bytes or fewer, or an odd number of pixels.
    """
    if width * height % 2:
        raise CameraError(f'{width}x{height} pixels cannot be packed two by two in three bytes; '
                          'a picture has an even number of pixels')
    expected = width * height * 3 // 2
    if len(data) != expected:
        raise CameraError(
            f'raw picture holds {len(data)} bytes, expected {expected} ({width}x{height}, 12 bits '
            'packed); the download was cut short or this is another format')
    counts = np.empty((height, width), np.uint16)
    _unpack(np.frombuffer(data, np.uint8), counts.reshape(-1))
    return counts


def pack12(counts: NDArray[np.uint16]) -> bytes:
    """The camera's bytes of counts (height, width); the inverse of `unpack12`."""
    if counts.size % 2 or counts.max(initial=0) > 4095:
        raise CameraError(f'cannot pack {counts.shape} counts up to {counts.max(initial=0)}: an '
                          'even number of 12-bit values is needed')
    first, second = counts.reshape(-1, 2).astype(np.uint16).T
    triples = np.stack([first >> 4, (first & 15) << 4 | second >> 8, second & 255], axis=1)
    return triples.astype(np.uint8).tobytes()


@compiled(parallel=True)
def _unpack(data, counts, portion):  # type: ignore[no-untyped-def]
    pairs = len(counts) // 2
    for task in rounds(-(-pairs // _PAIRS), portion):
        for pair in range(task * _PAIRS, min((task + 1) * _PAIRS, pairs)):
            first = np.uint16(data[3 * pair])
            middle = np.uint16(data[3 * pair + 1])
            last = np.uint16(data[3 * pair + 2])
            counts[2 * pair] = first << 4 | middle >> 4
            counts[2 * pair + 1] = (middle & 15) << 8 | last
