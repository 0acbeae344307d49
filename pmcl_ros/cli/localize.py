"""`pmcl localize`: the pose of an object, or of several, from one picture."""

import json
import logging
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import click
import numpy as np
from rich.progress import Progress, track

from pmcl_ros.cli.base import FOLDER, FORCE, MODE, OBJECT, STDERR, TRUTH, results_in
from pmcl_ros.cli.objects import OBJECT_ID, objects_of
from pmcl_ros.cli.region import GivenRegion, region_options, settled
from pmcl_ros.cli.sources import GivenSource, Opened, source_options
from pmcl_ros.drawing.pictures import depth_picture, displayed, outlines, overlay, write_png
from pmcl_ros.drawing.view_overlay import outlines_in_view, overlay_in_view
from pmcl_ros.evaluation.variants import Variant
from pmcl_ros.geometry.pose_error import pose_error
from pmcl_ros.geometry.truth import Truth
from pmcl_ros.lightfield.light_field import LightField
from pmcl_ros.lightfield.posed_view import PosedView, PosedViews
from pmcl_ros.lightfield.readers.read import Source, pictures_alone
from pmcl_ros.pipeline import Estimate, Pipeline, Run
from pmcl_ros.pmcl.estimate import PoseEstimate
from pmcl_ros.pmcl.modes import copy_beside
from pmcl_ros.pmcl.multi_object.scene_estimate import SceneEstimate
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.render.sunken import as_it_appears
from pmcl_ros.pmcl.settings import EvidenceKind, Mode, PmclSettings
from pmcl_ros.runtime.outputs import Results

_LOG = logging.getLogger(__name__)


@click.command()
@source_options
@click.option('--object', 'objects', multiple=True, type=OBJECT,
              help='A mesh, or an object YAML; several are found together.')
@OBJECT_ID
@region_options
@MODE
@click.option('--evidence', 'kind', type=click.Choice(['edges', 'map']),
              help='For --mode default: edges, or the contour map of the learned network. '
              'Pictures are searched in the map by default. A light field is searched in edges, '
              'and in the map too where edges lose its only object or are unsure of it.')
@click.option('--set', 'changes', multiple=True, metavar='KEY=VALUE,...', help="Other values of "
              "the search's or the volume's parameters.")
@click.option('--seed', type=click.IntRange(0), default=0, show_default=True,
              help='The same seed gives the same pose.')
@click.option('--json', 'as_json', is_flag=True, help='Print one JSON object on standard output.')
@click.option('--out', type=FOLDER, help='Folder for pictures.')
@click.option('--truth', type=TRUTH, help='A truth.json to compare with.')
@FORCE
def localize(source: GivenSource, objects: tuple[Path, ...], object_id: int | None,
             region: GivenRegion, mode: Mode, kind: EvidenceKind | None, changes: tuple[str, ...],
             seed: int, as_json: bool, out: Path | None, truth: Path | None,
             force: bool) -> None:
    """Find the object's pose in SOURCE: a raw picture, a light field or an ordinary picture.

    A raw picture is a .RAW, .RAW.xz (with its .TXT) or .LFP; it needs --calibration and --white. A
    light field is an .npz of `pmcl decode`, a folder of views with light_field.yaml, or a scene's
    folder of the 4D Light Field Benchmark. Pictures of ordinary cameras are a views.yaml, or the
    folder with it, the folder of a COLMAP text model or of a BOP scene, or a picture of one. With
    poses of the cameras, the region and the pose are in their reference frame. A bag is one of raw
    pictures, of views, of posed views, or a robot's of images, camera_info and poses.
    """
    results = None if out is None else results_in(out, force)
    objects, load = objects_of(source.source, objects, object_id)
    changed = Variant.parse(','.join(changes)) if changes else None
    if changed is not None and changed.base != 'default':
        raise click.UsageError(f'--set {" ".join(changes)}: there are no rows here; say --mode')
    of_search, of_volume = ((), ()) if changed is None else (changed.pmcl, changed.dlv)
    chosen = {} if kind is None else {'evidence': kind}
    settings = PmclSettings.make({'mode': mode, 'object': str(objects[0]), 'seed': seed}
                                 | region.settings() | chosen | dict(of_search),
                                 '--roi, --depths, --table, --tilt, --up, --mode, --evidence, '
                                 '--set, --seed')
    alone = pictures_alone(source.source)
    if alone:
        if len(objects) > 1 or truth is not None:
            raise click.UsageError(f'{source.source} has no camera poses, and each picture is '
                                   'localised alone: give one --object, and no --truth')
        STDERR.print('no camera poses: each picture is localised alone', markup=False)
        pictures = [replace(source, source=each) for each in alone]
        model = load(objects[0])
        settings, _ = settled(settings, pictures[0].open().read, model.radius)
        _localize_each(pictures, model, settings, dict(of_volume), as_json, results)
        return
    opened = source.open()
    if results is not None and not opened.posed:  # of posed views the number is not known yet
        results.reserve('overlay.png', *(['centre.png'] if len(objects) == 1 else []))
    if len(objects) == 1:
        _localize_one(opened, load(objects[0]), settings, dict(of_volume), truth, as_json, results)
        return
    if truth is not None:
        raise click.UsageError('--truth is of one object: give one --object')
    _localize_several(opened, objects, settings, dict(of_volume), as_json, results)


def _localize_one(opened: Opened, model: ObjectModel, settings: PmclSettings,
                  of_volume: dict[str, Any], truth: Path | None, as_json: bool,
                  results: Results | None) -> None:
    """Find an object, print its pose and, with the truth, its error, and draw it."""
    settings, read = settled(settings, opened.read, model.radius)
    pipeline = Pipeline.for_object(model, settings, of_volume, '--set', opened.posed)
    run = _run(pipeline, read, settings.seed, with_volume=results is not None)
    estimate = run.estimate
    _print(estimate, _seconds(run), as_json)
    other = copy_beside(model, estimate)
    if other is not None:
        _LOG.warning('at (%.4f, %.4f, %.4f) m is a pose with %.0f %% of the evidence: is there '
                     'another such object? To find both, give --object twice',
                     *other.pose[:3, 3], 100 * other.score / estimate.score)
    if truth is not None:
        known = Truth.load(truth)
        error = pose_error(estimate.pose, known.pose, model.symmetry)
        click.echo(f'the object is not there, says {truth}' if known.empty else
                   f'off by {1e3 * error.translation:.1f} mm and '
                   f'{np.rad2deg(error.rotation):.1f} degrees', err=True)
    if results is not None:
        results.remove_earlier()
        if isinstance(run.source, PosedViews):
            for number, view in enumerate(run.source.views):
                write_png(results.path(f'overlay_{number:03d}.png'), overlay_in_view(
                    view, model, estimate.pose, settings.interface))
        else:
            write_png(results.path('centre.png'), displayed(run.source))
            _draw(results.path('overlay.png'), run.source, model, estimate, settings)
        if run.volume is not None:
            write_png(results.path('depth.png'), depth_picture(
                run.volume.depth_map(), run.settings.near, run.settings.far))
        click.echo(f'pictures in {results.folder}', err=True)


def _localize_each(sources: Sequence[GivenSource], model: ObjectModel, settings: PmclSettings,
                   of_volume: dict[str, Any], as_json: bool, results: Results | None
                   ) -> None:
    """Find an object in each picture by itself, and print a pose a picture, in its camera."""
    found: list[dict[str, Any]] = []
    if results is not None:
        results.reserve(*(f'overlay_{each.source.stem}.png' for each in sources))
        results.remove_earlier()
    with Pipeline.for_object(model, settings, of_volume, '--set') as pipeline:
        for each in track(sources, 'pictures', console=STDERR, transient=True):
            run = pipeline.run(each.open().read, np.random.default_rng(settings.seed))
            name = each.source
            if as_json:
                found.append({'file': f'{name.parent.name}/{name.name}'}
                             | _as_dict(run.estimate, _seconds(run)))
            else:
                click.echo(f'{name.name}: {run.estimate.describe()}')
            if results is not None:
                assert isinstance(run.source, PosedView)
                _draw(results.path(f'overlay_{name.stem}.png'), run.source, model, run.estimate,
                      settings)
    if as_json:
        click.echo(json.dumps({'pictures': found}))


def _localize_several(opened: Opened, objects: Sequence[Path],
                      settings: PmclSettings, of_volume: dict[str, Any], as_json: bool,
                      results: Results | None) -> None:
    """Find objects together, print their poses, and draw their outlines.

    objects: meshes or object YAMLs; a file that is given twice stands for two copies.
    """
    loaded = {each: ObjectModel.load(each) for each in dict.fromkeys(objects)}
    models = [loaded[each] for each in objects]
    settings, read = settled(settings, opened.read, max(each.radius for each in models))
    run = _run(Pipeline.for_objects(models, settings, of_volume, '--set', opened.posed), read,
               settings.seed)
    scene = run.estimate
    _print(scene, {'dlv': run.seconds['views'] + run.seconds['evidence'],
                   'pmcl': run.seconds['pose']}, as_json)
    if results is not None:
        results.remove_earlier()
        there = [(model, each.pose, name) for model, each, name
                 in zip(models, scene.estimates, scene.names, strict=True) if not each.lost]
        if isinstance(run.source, PosedViews):
            for number, view in enumerate(run.source.views):
                write_png(results.path(f'overlay_{number:03d}.png'), outlines_in_view(
                    view, there, settings.interface))
            click.echo(f'pictures in {results.folder}', err=True)
            return
        write_png(results.path('overlay.png'), outlines(
            displayed(run.source), run.source.pinhole, there))
        click.echo(f'picture in {results.folder}', err=True)


def _draw(file: Path, source: LightField | PosedView, model: ObjectModel, estimate: PoseEstimate,
          settings: PmclSettings) -> None:
    """The outline of an object in the picture it was found in."""
    seen = as_it_appears(model, estimate.pose, settings.interface)
    write_png(file, overlay(displayed(source), source.pinhole, seen, estimate.pose))


def _run(pipeline: Pipeline[Estimate], read: Callable[[], Source], seed: int,
         with_volume: bool = False) -> Run[Estimate]:
    """Run and close a pipeline, with a progress bar."""
    with Progress(console=STDERR, transient=True) as bar, pipeline:
        task = bar.add_task('views', total=1.0)
        return pipeline.run(read, np.random.default_rng(seed), lambda stage, part: bar.update(
            task, description=stage, completed=part), with_volume=with_volume)


def _seconds(run: Run[PoseEstimate]) -> dict[str, float]:
    return {'decode': run.seconds['views'],
            'dlv': run.seconds['evidence'] + run.seconds.get('volume', 0.0),
            'pmcl': run.seconds['pose']}


def _as_dict(estimate: PoseEstimate | SceneEstimate, seconds: dict[str, float]) -> dict[str, Any]:
    return estimate.as_dict() | {
        'timings_ms': {name: 1e3 * each for name, each in seconds.items()}}


def _print(estimate: PoseEstimate | SceneEstimate, seconds: dict[str, float], as_json: bool
           ) -> None:
    if as_json:
        click.echo(json.dumps(_as_dict(estimate, seconds)))
    else:
        click.echo(estimate.describe())
        click.echo(', '.join(f'{name} {each:.2f} s' for name, each in seconds.items()), err=True)
