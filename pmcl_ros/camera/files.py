"""Raw pictures on disk: the camera's own .RAW (or .RAW.xz) with its .TXT beside it, or an .LFP."""

import lzma
import os
from pathlib import Path

from pmcl_ros.camera.lfp import (
    LARGEST_RAW,
    LARGEST_TEXT,
    Container,
    lfp_to_picture,
    named,
    picture_to_lfp,
)
from pmcl_ros.camera.metadata import CameraMetadata
from pmcl_ros.camera.packing import pack12, unpack12
from pmcl_ros.camera.raw_frame import RawFrame
from pmcl_ros.geometry.header import Header
from pmcl_ros.runtime.errors import CameraError
from pmcl_ros.runtime.outputs import refuse_existing, write_file

_RAW, _LFP = ('.RAW', '.RAW.XZ'), ('.LFP', '.LFR')
_MEMORY = 100 << 20  # most bytes for unpacking; files of `xz -9` need 65 MiB


def read_raw_frame(path: Path | str, header: Header | None = None) -> RawFrame:
    """Read NAME.RAW or NAME.RAW.xz with NAME.TXT, or NAME.LFP (.LFR), in any letter case.

    CameraError says which file is wrong and how.
    header: stamp and frame; by default the stamp is the file's modification time.
    """
    path = Path(path)
    raw, text = read_picture(path)
    with named(path):
        metadata = _parsed(path, text)
        counts = unpack12(raw, metadata.image.width, metadata.image.height)
        if header is None:
            header = Header(stamp_ns=path.stat().st_mtime_ns)
        return RawFrame(header, counts, metadata)


def read_metadata(path: Path | str) -> CameraMetadata:
    """Read the metadata of a picture without its pixels; `path` as of `read_raw_frame`."""
    path = Path(path)
    if _is_lfp(path):
        text = lfp_to_picture(Container.open(path))[1]
    else:
        with named(path):
            text = _read_text(_text_beside(path))
    with named(path):
        return _parsed(path, text)


def read_picture(path: Path | str) -> tuple[bytes, str]:
    """Packed counts and JSON text as the camera wrote them; `path` as of `read_raw_frame`."""
    path = Path(path)
    if _is_lfp(path):
        return lfp_to_picture(Container.open(path))
    with named(path):
        text = _read_text(_text_beside(path))
        return _read_xz(path) if path.suffix.lower() == '.xz' else _read(path, LARGEST_RAW), text


def write_raw_frame(path: Path | str, frame: RawFrame, force: bool = False) -> None:
    """Write NAME.RAW or NAME.RAW.xz with NAME.TXT, or NAME.LFP, as the end of `path` says.

    The folder is made. Raises CameraError when `path` ends otherwise, OutputError when a file
    cannot be written, or is there already with other contents, unless `force`.
    """
    write_picture(path, pack12(frame.counts), frame.metadata.text, force)


def write_picture(path: Path | str, raw: bytes, text: str, force: bool = False) -> None:
    """Like `write_raw_frame`, from packed counts and JSON text."""
    path = Path(path)
    with named(path):
        if _is_lfp(path):
            files = {path: picture_to_lfp(raw, text)}
        else:
            files = {path.with_name(_text_name(path)): text.encode('utf-8', 'replace'),
                     path: lzma.compress(raw, preset=1) if path.suffix.lower() == '.xz' else raw}
        new = {each: data for each, data in files.items() if not _holds(each, data)}
        refuse_existing(new, force)
        for each, data in new.items():
            write_file(each, data)


def picture_files(path: Path) -> list[Path]:
    """The files of a picture that `write_picture` writes."""
    return [path] if _is_lfp(path) else [path, path.with_name(_text_name(path))]


def list_pictures(path: Path | str) -> list[Path]:
    """The raw pictures at `path`: the file itself, or a folder's and its subfolders', sorted.

    Raises CameraError when there is none.
    """
    path = Path(path)
    if path.is_file():
        return [path]
    if not path.exists():
        raise CameraError(f'there is no {path}')
    found = sorted(each for each in path.rglob('*') if is_picture(each))
    if not found:
        raise CameraError(f'no .RAW, .RAW.xz or .LFP picture in {path}; pmcl camera capture '
                          'takes pictures, pmcl bag extract has those of a bag')
    return found


def is_picture(path: Path) -> bool:
    """Whether a file exists and has a name that `read_raw_frame` accepts."""
    return path.is_file() and (_is_lfp(path) or path.name.upper().endswith(_RAW))


def _is_lfp(path: Path) -> bool:
    return path.suffix.upper() in _LFP


def _text_name(path: Path) -> str:
    """NAME.TXT of NAME.RAW and NAME.RAW.xz."""
    for end in _RAW:
        if path.name.upper().endswith(end):
            return path.name[:-len(end)] + '.TXT'
    raise CameraError('not a .RAW, .RAW.xz or .LFP picture')


def _text_beside(path: Path) -> Path:
    name = _text_name(path)
    if path.with_name(name).exists():
        return path.with_name(name)
    for each in sorted(path.parent.iterdir()) if path.parent.is_dir() else ():
        if each.name.upper() == name.upper():
            return each
    raise CameraError(f'no {name} beside it: a picture needs the metadata that the camera '
                      'wrote')


def _parsed(path: Path, text: str) -> CameraMetadata:
    with named('' if _is_lfp(path) else _text_beside(path).name):
        return CameraMetadata.parse(text)


def _read(path: Path, largest: int) -> bytes:
    with path.open('rb') as stream:
        size = os.fstat(stream.fileno()).st_size
        if size > largest:
            raise CameraError(f'{path.name} holds more than {largest} bytes; a picture has about '
                              '16 million, its text some ten thousand')
        return stream.read(size)


def _read_text(path: Path) -> str:
    try:
        return _read(path, LARGEST_TEXT).decode('utf-8')
    except UnicodeDecodeError:
        raise CameraError(f'{path.name} is not text; expected the JSON of the camera') from None


def _read_xz(path: Path) -> bytes:
    stream = lzma.LZMADecompressor(lzma.FORMAT_XZ, _MEMORY)
    try:
        data = stream.decompress(_read(path, LARGEST_RAW), LARGEST_RAW + 1)
    except lzma.LZMAError as error:
        raise CameraError(f'not a complete xz file ({error})') from None
    if len(data) > LARGEST_RAW:
        raise CameraError(f'holds more than {LARGEST_RAW} bytes; a picture has about 16 million')
    if not stream.eof or stream.unused_data.strip(b'\0'):
        raise CameraError('not a complete xz file ('
                          f'{"more follows" if stream.eof else "it was cut short"})')
    return data


def _holds(path: Path, data: bytes) -> bool:
    """Whether a file has these contents already."""
    return path.is_file() and path.stat().st_size == len(data) and path.read_bytes() == data
