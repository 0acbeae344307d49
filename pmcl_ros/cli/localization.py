"""What `pmcl localize` does with an opened source: it searches, prints and draws."""

import json
import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import numpy as np
from rich.progress import Progress, track
from scipy.spatial.distance import pdist

from pmcl_ros.cli.base import STDERR
from pmcl_ros.cli.region import settled
from pmcl_ros.cli.sources import GivenSource, Opened
from pmcl_ros.drawing.pictures import depth_picture, displayed, outlines, overlay, write_png
from pmcl_ros.drawing.view_overlay import outlines_in_view, overlay_in_view
from pmcl_ros.evaluation.named_log import log_named
from pmcl_ros.geometry.pose_error import pose_error
from pmcl_ros.geometry.truth import Truth
from pmcl_ros.lightfield.light_field import LightField
from pmcl_ros.lightfield.posed_view import PosedView, PosedViews
from pmcl_ros.lightfield.readers.read import Source
from pmcl_ros.pipeline import Estimate, Pipeline, Run
from pmcl_ros.pmcl.estimate import PoseEstimate
from pmcl_ros.pmcl.modes import copy_beside
from pmcl_ros.pmcl.multi_object.scene_estimate import SceneEstimate
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.render.sunken import as_it_appears
from pmcl_ros.pmcl.settings import PmclSettings
from pmcl_ros.runtime.outputs import Results

_LOG = logging.getLogger(__name__)


@dataclass(frozen=True)
class Request:
    """How to search, and how to give what is found: as text or JSON, and drawn in `results`.

    of_volume: other values of the volume's parameters.
    """

    settings: PmclSettings
    of_volume: dict[str, Any]
    as_json: bool
    results: Results | None


def localize_one(opened: Opened, model: ObjectModel, request: Request, truth: Path | None) -> None:
    """Find an object, print its pose and, with the truth, its error, and draw it."""
    settings, read = settled(request.settings, opened.read, model.radius)
    pipeline = Pipeline.for_object(model, settings, request.of_volume, '--set', opened.posed)
    run = _run(pipeline, read, settings.seed, with_volume=request.results is not None)
    _print(run.estimate, _seconds(run), request.as_json)
    _warn_of_copy(model, run.estimate)
    if run.estimate.lost and opened.scaled and isinstance(run.source, PosedViews):
        _ask_scale(run.source)
    if truth is not None:
        _print_error(model, run.estimate, truth)
    if request.results is not None:
        request.results.remove_earlier()
        _draw_one(request.results, run, model, settings)
        click.echo(f'pictures in {request.results.folder}', err=True)


def localize_each(sources: Sequence[GivenSource], model: ObjectModel, request: Request) -> None:
    """Find an object in each picture by itself, and print a pose a picture, in its camera.

    A region of what is in view is that of the first picture.
    """
    settings, _ = settled(request.settings, sources[0].open().read, model.radius)
    results, found = request.results, list[dict[str, Any]]()
    if results is not None:
        results.reserve(*(f'overlay_{each.source.stem}.png' for each in sources))
        results.remove_earlier()
    with Pipeline.for_object(model, settings, request.of_volume, '--set') as pipeline:
        for each in track(sources, 'pictures', console=STDERR, transient=True):
            name = each.source
            with log_named(name.name):
                run = pipeline.run(each.open().read, np.random.default_rng(settings.seed))
            if request.as_json:
                found.append({'file': f'{name.parent.name}/{name.name}'}
                             | json_values(run.estimate, _seconds(run)))
            else:
                click.echo(f'{name.name}: {run.estimate.describe()}')
            if results is not None:
                assert isinstance(run.source, PosedView)
                _draw(results.path(f'overlay_{name.stem}.png'), run.source, model, run.estimate,
                      settings)
    if request.as_json:
        click.echo(json.dumps({'pictures': found}))


def localize_several(opened: Opened, objects: Sequence[Path], request: Request) -> None:
    """Find objects together, print their poses, and draw their outlines.

    objects: meshes or object YAMLs; a file that is given twice stands for two copies.
    """
    loaded = {each: ObjectModel.load(each) for each in dict.fromkeys(objects)}
    models = [loaded[each] for each in objects]
    settings, read = settled(request.settings, opened.read, max(each.radius for each in models))
    run = _run(Pipeline.for_objects(models, settings, request.of_volume, '--set', opened.posed),
               read, settings.seed)
    _print(run.estimate, {'dlv': run.seconds['views'] + run.seconds['evidence'],
                          'pmcl': run.seconds['pose']}, request.as_json)
    if request.results is not None:
        request.results.remove_earlier()
        number = _draw_several(request.results, run, models, settings)
        click.echo(f'picture{"s" * (number > 1)} in {request.results.folder}', err=True)


def _run(pipeline: Pipeline[Estimate], read: Callable[[], Source], seed: int,
         with_volume: bool = False) -> Run[Estimate]:
    """Run and close a pipeline, with a progress bar."""
    with Progress(console=STDERR, transient=True) as bar, pipeline:
        task = bar.add_task('views', total=1.0)
        return pipeline.run(read, np.random.default_rng(seed), lambda stage, part: bar.update(
            task, description=stage, completed=part), with_volume=with_volume)


def _warn_of_copy(model: ObjectModel, estimate: PoseEstimate) -> None:
    other = copy_beside(model, estimate)
    if other is not None:
        _LOG.warning('at (%.4f, %.4f, %.4f) m is a pose with %.0f %% of the evidence: is there '
                     'another such object? To find both, give --object twice',
                     *other.pose[:3, 3], 100 * other.score / estimate.score)


def _ask_scale(views: PosedViews) -> None:
    places = np.array([each.camera_to_reference[:3, 3] for each in views.views])
    _LOG.warning('lost: is the metric scale of --scale or --distance right? By it cameras are up '
                 'to %.3g m apart', pdist(places).max(initial=0))


def _print_error(model: ObjectModel, estimate: PoseEstimate, truth: Path) -> None:
    known = Truth.load(truth)
    error = pose_error(estimate.pose, known.pose, model.symmetry)
    click.echo(f'the object is not there, says {truth}' if known.empty else
               f'off by {1e3 * error.translation:.1f} mm and '
               f'{np.rad2deg(error.rotation):.1f} degrees', err=True)


def _draw_one(results: Results, run: Run[PoseEstimate], model: ObjectModel,
              settings: PmclSettings) -> None:
    if isinstance(run.source, PosedViews):
        for number, view in enumerate(run.source.views):
            write_png(results.path(f'overlay_{number:03d}.png'), overlay_in_view(
                view, model, run.estimate.pose, settings.interface))
    else:
        write_png(results.path('centre.png'), displayed(run.source))
        _draw(results.path('overlay.png'), run.source, model, run.estimate, settings)
    if run.volume is not None:
        write_png(results.path('depth.png'), depth_picture(
            run.volume.depth_map(), run.settings.near, run.settings.far))


def _draw_several(results: Results, run: Run[SceneEstimate], models: Sequence[ObjectModel],
                  settings: PmclSettings) -> int:
    """Number of pictures written."""
    there = [(model, each.pose, name) for model, each, name in zip(
        models, run.estimate.estimates, run.estimate.names, strict=True) if not each.lost]
    if isinstance(run.source, PosedViews):
        for number, view in enumerate(run.source.views):
            write_png(results.path(f'overlay_{number:03d}.png'), outlines_in_view(
                view, there, settings.interface))
        return len(run.source.views)
    write_png(results.path('overlay.png'), outlines(
        displayed(run.source), run.source.pinhole, there))
    return 1


def _draw(file: Path, source: LightField | PosedView, model: ObjectModel, estimate: PoseEstimate,
          settings: PmclSettings) -> None:
    """The outline of an object in the picture it was found in."""
    seen = as_it_appears(model, estimate.pose, settings.interface)
    write_png(file, overlay(displayed(source), source.pinhole, seen, estimate.pose))


def _seconds(run: Run[PoseEstimate]) -> dict[str, float]:
    return {'decode': run.seconds['views'],
            'dlv': run.seconds['evidence'] + run.seconds.get('volume', 0.0),
            'pmcl': run.seconds['pose']}


def json_values(estimate: PoseEstimate | SceneEstimate, seconds: dict[str, float]
                ) -> dict[str, Any]:
    """What --json prints of an estimate. seconds: of the stages, by name."""
    return estimate.as_dict() | {
        'timings_ms': {name: 1e3 * each for name, each in seconds.items()}}


def _print(estimate: PoseEstimate | SceneEstimate, seconds: dict[str, float], as_json: bool
           ) -> None:
    if as_json:
        click.echo(json.dumps(json_values(estimate, seconds)))
    else:
        click.echo(estimate.describe())
        click.echo(', '.join(f'{name} {each:.2f} s' for name, each in seconds.items()), err=True)
