"""The objects that a command looks for: files, or one of a BOP scene."""

from collections.abc import Callable
from pathlib import Path

import click

from pmcl_ros.cli.base import STDERR
from pmcl_ros.lightfield.readers import bop
from pmcl_ros.pmcl.object_model import ObjectModel

OBJECT_ID = click.option(
    '--object-id', type=click.IntRange(0), metavar='N', help='For a BOP scene, in place of '
    "--object: the data set's object N, models/obj_00000N.ply in millimetres.")


def objects_of(source: Path, paths: tuple[Path, ...], object_id: int | None
               ) -> tuple[tuple[Path, ...], Callable[[Path], ObjectModel]]:
    """The files of the objects that are looked for, and what reads them.

    object_id: of the BOP scene `source`, in place of `paths`: its file is printed. Raises
    UsageError where none is given, or both; LightFieldError where there is no such file.
    """
    if (object_id is None) == (not paths):
        raise click.UsageError('say which object: --object with its mesh '
                               '(docs/howto/object.md), or --object-id of a BOP scene')
    if object_id is None:
        return paths, ObjectModel.load
    mesh = bop.model_of(source, object_id)
    STDERR.print(f'object: {mesh}, in millimetres', markup=False, soft_wrap=True)
    return (mesh,), ObjectModel.load_bop
