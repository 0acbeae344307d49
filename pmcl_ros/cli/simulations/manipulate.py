"""`pmcl manipulate`: a simulated robot takes an object from water, by what its camera sees."""

import signal
import sys
from pathlib import Path

import click

from pmcl_ros.cli.base import CAMERA, FOLDER, FORCE, STDERR, counter, results_in
from pmcl_ros.evaluation.manipulation.findings import HEAD, causes, rows
from pmcl_ros.evaluation.manipulation.page import page
from pmcl_ros.evaluation.manipulation.series import Series
from pmcl_ros.evaluation.results import table
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.runtime.outputs import write_file
from pmcl_ros.runtime.resources import resolve
from pmcl_ros.runtime.ros_domain import own_domain
from pmcl_ros.simulation.lytro.camera import F01, F01_RAW
from pmcl_ros.simulation.manipulation.camera_kinds import load_camera
from pmcl_ros.simulation.manipulation.physics import mujoco
from pmcl_ros.simulation.manipulation.workplace import OBJECTS, WorkplaceKind
from pmcl_ros.simulation.warm_up import RAW_PICTURES, RENDER
from pmcl_ros.warm_up.chain import SEARCH
from pmcl_ros.warm_up.raw import DECODE
from pmcl_ros.warm_up.stage import compile_ahead

NAME = 'manipulation.html'
_CAMERA = 'package://pmcl_ros/config/manipulation/camera.yaml'
_SAMPLES = {F01: 12, F01_RAW: 1}  # an F01's view has a third of the pixels: as many rays


@click.command()
@click.argument('place', type=click.Choice(list(OBJECTS)))
@click.option('--trials', 'count', type=click.IntRange(1), default=10, show_default=True,
              help='Those that are in --out are kept.')
@click.option('--seed', type=click.IntRange(0), default=0, show_default=True,
              help='Trial k is that of seed + k.')
@click.option('--camera', metavar='FILE', help='At the wrist: an ordinary one, YAML, as of `pmcl '
              f'simulate`; or {F01}: centre views of an F01, 39 degrees wide; or {F01_RAW}: its '
              'raw pictures, decoded by subaperture_node. Default: 640x480, 56 degrees wide.')
@click.option('--renderer', type=click.Choice(['fast', 'physical']), default='fast',
              show_default=True, help="fast: the package's own; physical: path tracing, extra "
              "'simulate', which needs hundreds of samples below water.")
@click.option('--samples', type=click.IntRange(1), show_default='4; of f01 12; of a raw pixel 1',
              help='Rays or paths per pixel.')
@click.option('--undeclared', is_flag=True, help='Do not tell pmcl_node where the surface of the '
              'water is.')
@click.option('-o', '--out', required=True, type=FOLDER, help=f'Folder for {NAME} and the trials.')
@FORCE
def manipulate(place: WorkplaceKind, count: int, seed: int, camera: str | None, renderer: str,
               samples: int | None, undeclared: bool, out: Path, force: bool) -> None:
    """Let a simulated robot take an object out of water, and count.

    sink: a glass, which it puts upright on a tray. tank: a floating bottle, which it lifts.

    The nodes of this package run as they do on a robot; arm and gripper are simulated by MuJoCo
    (extra 'manipulate'). Every task is tried again by a robot that is given the true pose.
    """
    mujoco()  # said at once where it is missing
    own_domain()
    name, mass = OBJECTS[place]
    if camera not in (F01, F01_RAW):
        camera = str((Path(camera) if camera else resolve(_CAMERA, 'camera')).resolve())
        if not Path(camera).is_file():
            raise click.BadParameter(f'there is no file {camera}. {CAMERA.how}',
                                     param_hint='--camera')
    load_camera(camera)  # said at once where it is none
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # its programs end with it
    samples = samples or _SAMPLES.get(camera, 4)
    object_file = resolve(f'package://pmcl_ros/config/objects/{name}.yaml', 'object')
    series = Series(place, object_file, mass, camera, renderer, samples, out.resolve(),
                    not undeclared, force)
    series.claim()
    written = results_in(out, force).path(NAME)
    seeds = range(seed, seed + count)
    is_raw = camera == F01_RAW
    compile_ahead(STDERR, (*SEARCH, *((*DECODE, *RAW_PICTURES) if is_raw else
                                      RENDER if renderer == 'fast' else ())))
    seen, given = [], []
    with counter() as bar:
        task = bar.add_task('trials', total=count)
        for each in seeds:
            seen.append(series.run(each))
            given.append(series.run_by_truth(each))
            click.echo(f'{each}: {seen[-1].cause or "done"}', err=True)
            bar.advance(task)
    click.echo(table(HEAD, rows(seen) + rows(given)))
    for line in causes(seen):
        click.echo(line)
    about = {'object': name, 'camera': Path(camera).name,
             'pictures': f'{renderer}, {samples} samples of a pixel',
             'water': 'not declared' if undeclared else 'declared',
             'seeds': f'{seed} to {seed + count - 1}'}
    write_file(written, page(
        f'{name.capitalize()} out of a {place}', about, seen, given,
        [series.file(each).parent for each in seeds], ObjectModel.load(series.thing),
        series.pinhole, [series.water(each) for each in seeds]))
    click.echo(written)
