"""`pmcl profile`: measures a surface of revolution, an object without CAD, in posed views."""

import json
from pathlib import Path
from typing import get_args

import click
import numpy as np
from numpy.typing import NDArray

from pmcl_ros.cli.base import FOLDER, FORCE, STDERR, results_in
from pmcl_ros.cli.sources import GivenSource, view_options
from pmcl_ros.drawing.pictures import overlay, write_png
from pmcl_ros.lightfield.posed_view import PosedView, PosedViews
from pmcl_ros.pmcl.appearance import Material
from pmcl_ros.profiles.measure import measured
from pmcl_ros.profiles.measured import MeshKind
from pmcl_ros.profiles.outline import Box, resized
from pmcl_ros.runtime.errors import ProfileError
from pmcl_ros.runtime.outputs import refuse_existing
from pmcl_ros.warm_up.chain import ENERGIES
from pmcl_ros.warm_up.stage import compile_ahead

_UP = 0.0, 0.0, 1.0


@click.command()
@view_options
@click.option('--box', 'boxes', multiple=True, type=(int, float, float, float, float),
              metavar='VIEW X Y W H', help='The object in a view: number of the view, from 0, '
              'then left, top, width and height [px] in the undistorted picture, before '
              '--shrink. Give it for two views at least.')
@click.option('--points', multiple=True, type=(int, str), metavar='VIEW "X,Y ..."',
              help='In place of --box: the topmost, lowest, left and right points of the outline.')
@click.option('--up', type=(float, float, float), default=_UP, show_default=True,
              metavar='X Y Z', help='Approximate direction of the axis in the reference frame.')
@click.option('--height', type=click.FloatRange(0, 2, min_open=True), metavar='METRES',
              help='Height of the object, if known; one view is then enough.')
@click.option('--material', type=click.Choice(get_args(Material)), help='What the object is made '
              'of, as `appearance` of the object YAML says it. Of a clear one no depth of the '
              'surface is looked for.')
@click.option('-o', '--out', required=True, type=click.Path(dir_okay=False, path_type=Path),
              help='The object YAML; the mesh is written beside it.')
@click.option('--mesh', 'kind', type=click.Choice(['stl', 'obj', 'ply']), default='stl',
              show_default=True, help='Format of the mesh.')
@click.option('--pictures', type=FOLDER, help='Folder for the views with the outline found.')
@click.option('--json', 'as_json', is_flag=True, help='Print one JSON object.')
@FORCE
def profile(source: GivenSource, boxes: tuple[tuple[int, float, float, float, float], ...],
            points: tuple[tuple[int, str], ...], up: tuple[float, float, float],
            height: float | None, material: Material | None, out: Path, kind: MeshKind,
            pictures: Path | None, as_json: bool, force: bool) -> None:
    """Measure a vessel that SOURCE, posed views, shows, and write it as an object to look for.

    It is a surface of revolution, which stands alone in free view. Its outline is marked by --box
    or --points, or else in a window: without a screen one of the two is needed.
    """
    if out.suffix.lower() not in ('.yaml', '.yml'):
        raise click.UsageError(f'-o {out}: give the name of an object YAML, as glass.yaml')
    mesh = out.with_suffix(f'.{kind}')
    refuse_existing([out, mesh], force)
    marked, axis = _marked(boxes, points), _direction(up)
    if not marked:
        _check_screen()
    compile_ahead(STDERR, ENERGIES)
    views = _posed_views(source)
    marked = {view: resized(box, 1 / source.shrink) for view, box in marked.items()}
    missing = [each for each in marked if not 0 <= each < len(views)]
    if missing:
        raise ProfileError(f'there is no view {missing[0]}: {source.source} has {len(views)}, '
                           'numbered from 0')
    results = None if pictures is None else results_in(pictures, force)
    names = [f'profile_{number:03d}.png' for number in range(len(views))]
    if results is not None:
        results.reserve(*names)
    if not marked:
        from pmcl_ros.cli.box_window import boxes_in_window
        marked = boxes_in_window(views, 2 if height is None else 1, source.shrink)
    found = measured(views, marked, axis, height)
    out.parent.mkdir(parents=True, exist_ok=True)
    found.write(out, mesh, f'Made by: pmcl profile {source.source.name}. {found.describe()}',
                material)
    if results is not None:
        for name, view in zip(names, views, strict=True):
            pose = np.linalg.inv(view.camera_to_reference) @ found.pose
            write_png(results.path(name),
                      overlay(view.displayed(), view.pinhole, found.model, pose))
    if as_json:
        click.echo(json.dumps(found.as_dict()))
    else:
        click.echo(found.describe())
    STDERR.print(f'{out}, {mesh}', markup=False, soft_wrap=True)


def _marked(boxes: tuple[tuple[int, float, float, float, float], ...],
            points: tuple[tuple[int, str], ...]) -> dict[int, Box]:
    """Boxes by number of the view."""
    given = [(view, (x, y, width, height)) for view, x, y, width, height in boxes]
    given += [(view, box_about(text)) for view, text in points]
    marked = dict(given)
    if len(marked) < len(given):
        raise click.UsageError('a view has one --box or --points, not several')
    return marked


def _direction(up: tuple[float, float, float]) -> NDArray[np.float64]:
    """(3,) of unit length; UsageError where there is none."""
    length = float(np.linalg.norm(up))
    if not (np.isfinite(length) and length > 0):
        raise click.UsageError(f'--up {up}: it has no direction')
    return np.array(up) / length


def _check_screen() -> None:
    """UsageError where no window can be opened to mark the object in."""
    from pmcl_ros.cli.box_window import has_screen  # here: matplotlib takes most of a second
    if not has_screen():
        raise click.UsageError('say where the object is: --box or --points; there is no '
                               'screen for a window to mark it in')


def _posed_views(source: GivenSource) -> list[PosedView]:
    """The pictures of a source; ProfileError where it has other views."""
    read = source.open().read()
    views = read.views if isinstance(read, PosedViews) else (read,)
    posed = [each for each in views if isinstance(each, PosedView)]
    if not posed:
        raise ProfileError(f'{source.source} is a light field: a profile needs pictures with '
                           'camera poses, a views.yaml (docs/howto/profile.md)')
    return posed


def box_about(text: str) -> Box:
    """The box about points, `X,Y X,Y ...`; UsageError for others."""
    try:
        places = np.array([[float(each) for each in pair.split(',')] for pair in text.split()])
        if places.ndim != 2 or places.shape[1] != 2 or len(places) < 2:
            raise ValueError
    except ValueError:
        raise click.UsageError(f'--points {text!r}: expected two points or more, as '
                               '"310,120 280,300 350,310"') from None
    (left, top), (width, height) = places.min(axis=0), np.ptp(places, axis=0)
    return float(left), float(top), float(width), float(height)
