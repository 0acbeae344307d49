"""`pmcl lfp`: convert between Lytro's container files and the camera's own files."""

from pathlib import Path
from typing import Any

import click

from pmcl_ros.camera.files import (
    picture_files,
    read_metadata,
    read_raw_frame,
    write_raw_frame,
)
from pmcl_ros.camera.lfp import LARGEST_RAW, Container, file_set, is_file_set
from pmcl_ros.camera.metadata import CameraMetadata
from pmcl_ros.cli.base import FOLDER, FORCE, RAW
from pmcl_ros.runtime.errors import CameraError
from pmcl_ros.runtime.outputs import refuse_existing, write_file


@click.group()
def lfp() -> None:
    """Lytro's container files (.LFP): make them, take them apart, look into them."""


@lfp.command()
@click.argument('raw', type=RAW)
@click.argument('out', type=click.Path(dir_okay=False, path_type=Path))
@FORCE
def pack(raw: Path, out: Path, force: bool) -> None:
    """Make the container OUT.LFP of RAW (.RAW or .RAW.xz with its .TXT beside it)."""
    if out.suffix.upper() != '.LFP':
        raise CameraError(f'{out}: the name of a container ends in .LFP')
    frame = read_raw_frame(raw)
    write_raw_frame(out, frame, force)
    click.echo(f'{out}: {_described(frame.metadata)}')


@lfp.command()
@click.argument('file', type=RAW)
@click.argument('out', type=FOLDER)
@click.option('--only', default='*', show_default=True,
              help="Of the camera's own files: those of this name pattern, as 'MOD_*'.")
@FORCE
def unpack(file: Path, out: Path, only: str, force: bool) -> None:
    """Extract FILE to the folder OUT, and print the names of the files.

    A picture becomes the .RAW and .TXT of the camera. A set of the camera's own files (data.C.0
    and so on) is extracted file by file; MOD_* are its white images.
    """
    container = Container.open(file)
    if is_file_set(container):
        names = file_set(container, only)
        if not names:
            raise CameraError(f'{file}: holds no file called {only}')
        paths = [out / name for name in names]
        refuse_existing(paths, force)
        for path, reference in zip(paths, names.values(), strict=True):
            write_file(path, container.component(reference, LARGEST_RAW))
    else:
        frame = read_raw_frame(file)
        write_raw_frame(out / f'{file.stem}.RAW', frame, force)
        paths = picture_files(out / f'{file.stem}.RAW')
    for path in paths:
        click.echo(path)


@lfp.command()
@click.argument('file', type=RAW)
def info(file: Path) -> None:
    """Describe FILE and list its sections, each with its verified SHA-1."""
    container = Container.open(file)
    if is_file_set(container):
        roles = {reference: name for name, reference in file_set(container).items()}
        click.echo(f"{file}: {len(roles)} of a camera's own files")
    else:
        roles = _references(container.table)
        try:
            click.echo(f'{file}: {_described(read_metadata(file))}')
        except CameraError as error:  # a refocused stack has sections too
            click.echo(str(error))
    click.echo(f'{"byte":>10} {"length":>10}  {"SHA-1, verified":45}  holds')
    for each in container.sections:
        role = 'table of contents' if each.is_table else roles.get(each.reference, '')
        click.echo(f'{each.offset:>10} {each.length:>10}  {each.reference}  {role}')


def _described(metadata: CameraMetadata) -> str:
    image = metadata.image
    return (f'picture of camera {metadata.serial or "(unknown)"}, {image.width}x{image.height} '
            'pixels, 12 bits')


def _references(table: dict[str, Any]) -> dict[str, str]:
    """References -> their names, anywhere in the table."""
    found: dict[str, str] = {}
    left: list[Any] = [table]
    while left:
        part = left.pop()
        if isinstance(part, dict):
            found.update({value: name.removesuffix('Ref') for name, value in part.items()
                          if name.endswith('Ref') and isinstance(value, str)})
            left += part.values()
        elif isinstance(part, list):
            left += part
    return found
