"""The F01's 12-bit packing: two pixels in three bytes, big-endian (lytro_f01.md, B2)."""

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.errors import CameraError


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
    first, second, third = np.frombuffer(data, np.uint8).reshape(-1, 3).astype(np.uint16).T
    counts = np.stack([first << 4 | second >> 4, (second & 15) << 8 | third], axis=1)
    return counts.reshape(height, width)


def pack12(counts: NDArray[np.uint16]) -> bytes:
    """The camera's bytes of counts (height, width); the inverse of `unpack12`."""
    if counts.size % 2 or counts.max(initial=0) > 4095:
        raise CameraError(f'cannot pack {counts.shape} counts up to {counts.max(initial=0)}: an '
                          'even number of 12-bit values is needed')
    first, second = counts.reshape(-1, 2).astype(np.uint16).T
    triples = np.stack([first >> 4, (first & 15) << 4 | second >> 8, second & 255], axis=1)
    return triples.astype(np.uint8).tobytes()
