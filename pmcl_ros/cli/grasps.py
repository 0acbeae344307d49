"""`pmcl grasps`: makes grasps of an object for a gripper."""

from pathlib import Path

import click
import numpy as np
from rich.console import Console
from rich.table import Table

from pmcl_ros.cli.base import FILE, FORCE, OBJECT
from pmcl_ros.drawing.pictures import write_png
from pmcl_ros.grasps.clearance import Clearance, surface_points
from pmcl_ros.grasps.grasp import GraspFile
from pmcl_ros.grasps.revolution import Profile, grasps_of
from pmcl_ros.grasps.settings import GripperSettings
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.runtime.errors import GraspError
from pmcl_ros.runtime.outputs import refuse_existing

_SIGMAS = (0.002, 0.005)  # m: of the position, for the probability that a grasp is clear


@click.command()
@click.argument('object_file', metavar='OBJECT', type=OBJECT)
@click.option('--gripper', type=FILE, help="The gripper's sizes, YAML; default: a Fetch's.")
@click.option('-o', '--out', type=click.Path(dir_okay=False, path_type=Path),
              help='Write the grasps, for grasp_node, to this YAML file.')
@click.option('--picture', type=click.Path(dir_okay=False, path_type=Path),
              help='Draw each grasp on the profile of OBJECT, PNG.')
@FORCE
def grasps(object_file: Path, gripper: Path | None, out: Path | None, picture: Path | None,
           force: bool) -> None:
    """Make side, top and rim grasps for OBJECT, a surface of revolution.

    OBJECT: a mesh, or an object's YAML.
    """
    refuse_existing([each for each in (out, picture) if each is not None], force)
    sizes = GripperSettings() if gripper is None else GripperSettings.load(gripper)
    model = ObjectModel.load(object_file)
    found = grasps_of(model, sizes)
    if not found:
        raise GraspError(f'no grasp of {model.name!r} leaves {1000 * sizes.margin:g} mm of room '
                         f'on every side with an opening of {1000 * sizes.opening:g} mm')
    points = surface_points(model)
    clearances = [Clearance.from_points(each, points, sizes) for each in found]
    table = Table('grasp', 'kind', 'width', 'opening', 'beside', 'palm', 'tips',
                  *(f'clear at {1000 * sigma:g} mm' for sigma in _SIGMAS))
    for grasp, clearance in zip(found, clearances, strict=True):
        low, high = clearance.room
        rooms = (grasp.width, grasp.opening, min(-low[0], high[0]), -low[1], high[1])
        table.add_row(grasp.name, grasp.kind, *(f'{1000 * each:.1f}' for each in rooms),
                      *(f'{float(clearance.probability(sigma ** 2 * np.eye(3))):.3f}'
                        for sigma in _SIGMAS))
    Console(width=max(100, Console().width)).print(table)
    click.echo('lengths in mm; clear: the probability, with that standard deviation of the '
               'position on each axis')
    if not any(each.kind == 'rim' for each in found):
        click.echo('no rim grasp: the mesh has no cavity that a finger fits into', err=True)
    if out is not None:
        GraspFile.write(out, object_file, sizes, found,
                        f'Made by: pmcl grasps {object_file.name}. In the frame of the mesh, '
                        'metres: docs/howto/grasping.md')
        click.echo(out, err=True)
    if picture is not None:
        from pmcl_ros.drawing.grasp_picture import grasp_picture  # here: it imports matplotlib
        write_png(picture, grasp_picture(Profile.from_model(model), sizes, found, clearances))
        click.echo(picture, err=True)
