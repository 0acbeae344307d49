"""Unpacks what is compressed in bags, without trusting what it says of its size."""

from pathlib import Path

import lz4.frame
import zstandard

from pmcl_ros.runtime.errors import BagError

_MOST_TIMES = 1000  # larger than it is packed; what cameras see, some ten
_WINDOW = 2 ** 27  # bytes that the unpacker may keep


def unpacked(data: bytes | memoryview, compression: str, most: int) -> bytes | memoryview:
    """What `data` unpack to; BagError where that is more than `most` bytes, or they are damaged.

    compression: zstd, lz4, or empty for none.
    """
    try:
        if compression == 'zstd':
            with _zstd().stream_reader(data, read_across_frames=True) as stream:
                found: bytes | memoryview = stream.read(most + 1)
        elif compression == 'lz4':
            found = lz4.frame.LZ4FrameDecompressor().decompress(bytes(data), most + 1)
        elif not compression:
            found = data
        else:
            raise BagError(f'its compression {compression!r} is not known, only zstd and lz4')
    except (zstandard.ZstdError, RuntimeError, EOFError, MemoryError) as error:
        raise BagError(f'what is compressed with {compression} is damaged: {error}') from None
    if len(found) > most:
        raise BagError(f'{len(data)} bytes of {compression or "data"} unpack to more than {most}')
    return found


def unpack_file(packed: Path, path: Path) -> None:
    """Unpack a .zstd file to `path`; BagError as of `unpacked`."""
    left = _MOST_TIMES * (packed.stat().st_size + 1)
    try:
        with packed.open('rb') as source, path.open('wb') as target, _zstd().stream_reader(
                source, read_across_frames=True) as stream:
            while block := stream.read(min(left + 1, 2 ** 20)):
                left -= len(block)
                if left < 0:
                    raise BagError(f'{packed.name} unpacks to more than {_MOST_TIMES} times its '
                                   'size')
                target.write(block)
    except zstandard.ZstdError as error:
        raise BagError(f'{packed.name} is damaged: {error}') from None


def _zstd() -> zstandard.ZstdDecompressor:
    return zstandard.ZstdDecompressor(max_window_size=_WINDOW)
