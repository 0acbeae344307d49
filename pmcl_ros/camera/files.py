"""Raw pictures on disk: the camera's own .RAW (or .RAW.xz) with its .TXT beside it."""

import lzma
from pathlib import Path

from pmcl_ros.camera.metadata import CameraMetadata
from pmcl_ros.camera.packing import unpack12
from pmcl_ros.camera.raw_frame import RawFrame
from pmcl_ros.errors import CameraError
from pmcl_ros.header import Header

_LARGEST = 100_000_000  # bytes; an F01 picture has 16,137,600: more than this is no picture


def read_raw_frame(path: Path | str, header: Header | None = None) -> RawFrame:
    """Read NAME.RAW or NAME.RAW.xz and NAME.TXT; CameraError says which file is wrong and how.

    header: whose picture it is; by default the stamp is the file's modification time.
    """
    path = Path(path)
    try:
        text = _text_beside(path)
        metadata = _read_metadata(text)
        counts = unpack12(_read_bytes(path), metadata.image.width, metadata.image.height)
        if header is None:
            header = Header(stamp_ns=path.stat().st_mtime_ns)
        return RawFrame(header, counts, metadata)
    except OSError as error:
        name = error.filename or path
        raise CameraError(f'cannot read {name}: {error.strerror or error}') from None
    except CameraError as error:
        raise CameraError(f'{path}: {error}') from None


def list_pictures(path: Path | str) -> list[Path]:
    """The raw pictures at `path`: the file itself, or a folder's and its subfolders', sorted.

    Raises CameraError when there is none.
    """
    path = Path(path)
    if path.is_file():
        return [path]
    if not path.exists():
        raise CameraError(f'there is no {path}')
    found = sorted(each for each in path.rglob('*') if each.is_file() and _is_raw(each))
    if not found:
        raise CameraError(f'no .RAW or .RAW.xz picture in {path}')
    return found


def _is_raw(path: Path) -> bool:
    return path.name.upper().endswith(('.RAW', '.RAW.XZ'))


def _text_beside(path: Path) -> Path:
    if not _is_raw(path):
        raise CameraError('not a .RAW or .RAW.xz picture')
    stem = path.with_suffix('') if path.suffix.lower() == '.xz' else path
    for suffix in ('.TXT', '.txt'):
        if (text := stem.with_suffix(suffix)).exists():
            return text
    raise CameraError(f'no {stem.with_suffix(".TXT").name} beside it: the metadata that the '
                      'camera writes belongs to the picture')


def _read_metadata(path: Path) -> CameraMetadata:
    try:
        return CameraMetadata.parse(path.read_text(encoding='utf-8'))
    except UnicodeDecodeError:
        raise CameraError(f'{path.name} is not text; expected the JSON of the camera') from None
    except CameraError as error:
        raise CameraError(f'{path.name}: {error}') from None


def _read_bytes(path: Path) -> bytes:
    try:
        with lzma.open(path) if path.suffix.lower() == '.xz' else path.open('rb') as stream:
            data = stream.read(_LARGEST + 1)
    except (lzma.LZMAError, EOFError) as error:
        raise CameraError(f'not a complete xz file ({error})') from None
    if len(data) > _LARGEST:
        raise CameraError(f'holds more than {_LARGEST} bytes; a picture has about 16 million')
    return data
