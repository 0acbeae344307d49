"""`pmcl next-view`: from where one more picture would make a pose surest."""

import json
from collections.abc import Sequence
from pathlib import Path

import click
import numpy as np

from pmcl_ros.cli.base import FILE, OBJECT
from pmcl_ros.cli.objects import OBJECT_ID, objects_of
from pmcl_ros.cli.region import GivenRegion, region_options, settled
from pmcl_ros.cli.sources import GivenSource, Search, posed_options
from pmcl_ros.evidence.posed_evidence import ViewsEvidence
from pmcl_ros.lightfield.posed_view import PosedViews
from pmcl_ros.lightfield.sweep.view_plan import ViewPlan
from pmcl_ros.pipeline import Pipeline
from pmcl_ros.pmcl.multi_view.next_view import CANDIDATES, CAP, NextView, cap, next_views
from pmcl_ros.pmcl.settings import PmclSettings


@click.command('next-view')
@posed_options
@click.option('--object', 'object_path', type=OBJECT, help='A mesh, or an object YAML.')
@OBJECT_ID
@region_options
@click.option('--candidates', type=FILE, help='YAML file with `poses`: camera to the reference '
              'frame, 16 numbers each. Default: a cap about the present views.')
@click.option('--cap', 'degrees', type=click.FloatRange(1, 360), default=CAP, show_default=True,
              help='Angle that the default candidates span [deg].')
@click.option('--count', type=click.IntRange(1, 10_000), default=CANDIDATES, show_default=True,
              help='Number of default candidates.')
@click.option('--seed', type=click.IntRange(0), default=0, show_default=True)
@click.option('--json', 'as_json', is_flag=True, help='Print one JSON object.')
def next_view(source: GivenSource, object_path: Path | None, object_id: int | None,
              region: GivenRegion, candidates: Path | None, degrees: float, count: int, seed: int,
              as_json: bool) -> None:
    """Tell from where one more picture of SOURCE, posed views, would make the pose surest.

    Prints the largest standard deviation of the position now, and with a view from each of the
    five best candidates. The camera pose of a candidate counts as uncertain as that of the first
    view. Exit status 3: the object is lost, and no view can be chosen.
    """
    if candidates is not None and (degrees, count) != (CAP, CANDIDATES):
        raise click.UsageError('--cap and --count are of the default candidates: leave them out, '
                               'or --candidates')
    opened = source.open(Search())
    if not opened.posed:
        raise click.UsageError(f'{source.source} has no poses of its cameras: a next view needs '
                               'them, as views.yaml gives them (docs/howto/posed_views.md)')
    plan = None if candidates is None else ViewPlan.load(candidates)  # before the search
    (path,), load = objects_of(source.source, () if object_path is None else (object_path,),
                               object_id)
    settings = PmclSettings.make({'object': str(path), 'seed': seed} | region.settings(),
                                 '--roi, --depths, --table, --tilt, --up, --seed')
    model = load(path)
    settings, read = settled(settings, opened.read, model.radius)
    with Pipeline.for_object(model, settings, posed=True) as pipeline:
        run = pipeline.run(read, np.random.default_rng(seed))
    assert isinstance(run.source, PosedViews)
    assert isinstance(run.evidence, ViewsEvidence)
    click.echo(run.estimate.describe(), err=True)
    if run.estimate.lost:
        raise SystemExit(3)
    cameras = (cap(run.estimate.pose, [each.camera_to_reference for each in run.source.views],
                   degrees, count) if plan is None else
               plan.cameras_in(run.source.header.frame_id, str(candidates)))
    found = next_views(run.estimate.found_in(run.evidence), model, settings,
                       run.estimate.pose, cameras, run.source.views[0].pinhole)
    _print(found, as_json)


def _print(found: Sequence[NextView], as_json: bool) -> None:
    if as_json:
        click.echo(json.dumps({'sigma_now': found[0].now, 'views': [
            {'camera_to_reference': each.camera.ravel().tolist(), 'sigma': each.sigma}
            for each in found]}))
        return
    click.echo(f'now: {1e3 * found[0].now:.2f} mm')
    for each in found[:5]:
        click.echo(each.describe())
