"""`pmcl sweep`: light fields from an ordinary camera that an arm moves."""

from pathlib import Path

import click
import numpy as np

from pmcl_ros.cli.base import FORCE, STDERR
from pmcl_ros.evaluation.recall import values
from pmcl_ros.evaluation.results import table
from pmcl_ros.evaluation.studies.sweep import Arm, compare
from pmcl_ros.evaluation.trials import Trial
from pmcl_ros.lightfield.posed_view import quaternion_pose
from pmcl_ros.lightfield.sweep.plan import (
    BASELINES,
    MATCHING,
    SweepPlan,
    depth_resolution,
    width_for,
)
from pmcl_ros.runtime.outputs import refuse_existing
from pmcl_ros.simulation.scenes.random_scene import KINDS, SceneSettings
from pmcl_ros.simulation.warm_up import RENDER
from pmcl_ros.warm_up.chain import EDGES, SEARCH, VOLUME
from pmcl_ros.warm_up.stage import compile_ahead

_Pose = tuple[float, float, float, float, float, float, float]


@click.group()
def sweep() -> None:
    """Light fields from an ordinary camera that an arm moves."""


@sweep.command()
@click.option('--distance', required=True, type=click.FloatRange(0, min_open=True),
              help='Distance of the objects [m].')
@click.option('--resolution', required=True, type=click.FloatRange(0, min_open=True),
              help='Wanted standard deviation of depth there [m].')
@click.option('--fx', required=True, type=click.FloatRange(1), help='Focal length [px].')
@click.option('--size', type=click.IntRange(16), nargs=2, metavar='WIDTH HEIGHT',
              help='Size of the images [px], to print the common part of all views.')
@click.option('--matching', type=click.FloatRange(0, min_open=True), default=MATCHING,
              show_default=True, help='Standard deviation of a displacement [px].')
@click.option('--views', type=click.IntRange(2, 99), nargs=2, default=(5, 5), show_default=True,
              metavar='ROWS COLUMNS', help='Of the grid.')
@click.option('--pose', type=float, nargs=7, metavar='X Y Z QX QY QZ QW',
              help="Pose of the camera's optical frame at the grid's middle, in --frame; default: "
              "poses relative to that camera.")
@click.option('--frame', default='base_link', show_default=True, help='Frame of --pose.')
@click.option('-o', '--out', required=True, type=click.Path(dir_okay=False, path_type=Path),
              help='The plan, YAML.')
@FORCE
def plan(distance: float, resolution: float, fx: float, size: tuple[int, int] | None,
         matching: float, views: tuple[int, int], pose: _Pose | None, frame: str, out: Path,
         force: bool) -> None:
    """Write the poses of a sweep for a wanted depth resolution.

    sigma_z = z^2 sigma_d / (f B): the width B of the sweep, from its first view to its last,
    follows from the distance z, the focal length f and the error sigma_d of a displacement.
    """
    refuse_existing([out], force)
    width = width_for(distance, fx, resolution, matching)
    rows, columns = views
    step = width / (max(rows, columns) - 1)
    least, largest = BASELINES
    if not least <= step <= largest:
        raise click.UsageError(
            f'neighbouring views would be {step:.3g} m apart, not {least:.5f} to {largest:g} m: '
            'are --distance and --resolution in metres?')
    middle = None if pose is None else quaternion_pose(pose[:3], pose[3:], '--pose')
    made = SweepPlan.from_grid(rows, columns, round(step, 6), middle, frame if pose else '')
    width = made.baseline * (max(rows, columns) - 1)
    sigma = depth_resolution(distance, fx, width, matching)
    made.save(out, f'{rows}x{columns} views for a depth resolution of {1e3 * sigma:.2f} mm at '
              f'{distance} m\nframe: {made.frame or "that of the camera at the middle"}')
    click.echo(f'{len(made.poses)} poses in {out}: {rows}x{columns} views, '
               f'{1e3 * made.baseline:.2f} mm apart, {1e3 * width:.1f} mm wide')
    click.echo(f'depth resolution at {distance} m: {1e3 * sigma:.2f} mm (z^2 sigma_d / (f B), '
               f'sigma_d {matching} px, f {fx:g} px); neighbouring views move by '
               f'{fx * made.baseline / distance:.1f} px')
    if size:
        shares = [1 - (count - 1) * made.baseline * fx / distance / pixels
                  for count, pixels in zip((columns, rows), size, strict=True)]
        click.echo(f'at {distance} m {100 * max(shares[0], 0) * max(shares[1], 0):.0f} % of the '
                   "centre view's picture are in all views")


@sweep.command('compare')
@click.option('--count', type=click.IntRange(1), default=10, show_default=True, help='Scenes.')
@click.option('--seed', type=click.IntRange(0), default=0, show_default=True, help='Of the first.')
@click.option('--kind', 'kinds', multiple=True, type=click.Choice(KINDS),
              default=('opaque', 'glass'), show_default=True, help='Of scenes; may be repeated.')
@click.option('--width', 'widths', multiple=True, type=click.FloatRange(0.001, 2),
              default=(0.03, 0.1), show_default=True, help='Of a sweep [m]; may be repeated.')
@click.option('--views', type=click.IntRange(3, 31), default=5, show_default=True,
              help='Of a row and a column of a sweep.')
@click.option('--size', type=click.IntRange(64), default=328, show_default=True,
              help='Side of a view [px].')
@click.option('--unknown', type=click.FloatRange(0), default=0.0, show_default=True,
              help="Standard deviation of the error of each position of the sweep's camera, on "
              'each axis [m].')
@click.option('--unknown-turn', type=click.FloatRange(0), default=0.0, show_default=True,
              help='Standard deviation of the error of its direction, about each axis [rad].')
@click.option('--each', 'singly', is_flag=True, help='Print each scene instead of medians.')
def compare_cameras(count: int, seed: int, kinds: tuple[str, ...], widths: tuple[float, ...],
                    views: int, size: int, unknown: float, unknown_turn: float, singly: bool
                    ) -> None:
    """Compare poses in generated scenes from a light-field camera and from sweeps."""
    settings = SceneSettings.make({'kinds': kinds, 'empty': 0, 'outside': 0, 'size': size},
                                  'pmcl sweep compare')
    compile_ahead(STDERR, (*SEARCH, *RENDER, *VOLUME, *EDGES))
    arm = Arm(unknown=unknown, unknown_turn=unknown_turn)
    found: list[Trial] = []
    with STDERR.status('scenes') as status:
        for each in compare(count, seed, widths, views, settings, arm):
            found.append(each)
            status.update(f'{each.seed}: {each.capture}, {each.mode}')
    groups: dict[tuple[str, str], list[Trial]] = {}
    for each in found:
        name = f'{each.seed}: {each.capture}' if singly else each.capture.partition(':')[0]
        groups.setdefault((name, each.mode), []).append(each)
    rows = sorted(groups.items(), key=lambda group: group[0][0])
    click.echo(table(['scenes', 'camera', 'depth error', 'pose error', 'along the ray',
                      'axis error', 'estimated sigma along the ray', 'lost'],
                     [[*names, *_row(of)] for names, of in rows]))


def _row(trials: list[Trial]) -> list[str]:
    """Medians over scenes."""
    units = {'depth_mm': ' mm', 'translation_mm': ' mm', 'ray_mm': ' mm', 'axis_deg': '°',
             'sigma_mm': ' mm'}
    return [*(f'{np.nanmedian(abs(values(trials, name))):.2f}{unit}'
              for name, unit in units.items()),
            f'{sum(each.lost for each in trials)} of {len(trials)}']
