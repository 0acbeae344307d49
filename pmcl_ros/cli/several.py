"""`pmcl localize` with several objects."""

import json
from collections.abc import Callable, Sequence
from pathlib import Path

import click
import numpy as np
from rich.progress import Progress

from pmcl_ros.cli.base import STDERR
from pmcl_ros.drawing.pictures import outlines, write_png
from pmcl_ros.lightfield.light_field import LightField
from pmcl_ros.pipeline import Pipeline
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.settings import PmclSettings


def localize_several(read: Callable[[], LightField], objects: Sequence[Path],
                     settings: PmclSettings, of_volume: dict[str, object], as_json: bool,
                     out: Path | None) -> None:
    """Find objects together in a light field, tell where they are, and draw their outlines.

    objects: meshes or object YAMLs; one that is there twice: two copies.
    """
    loaded = {each: ObjectModel.load(each) for each in dict.fromkeys(objects)}
    models = [loaded[each] for each in objects]
    with (Progress(console=STDERR, transient=True) as bar,
          Pipeline.for_objects(models, settings, of_volume, '--set') as pipeline):
        task = bar.add_task('views', total=1.0)
        run = pipeline.run(read, np.random.default_rng(settings.seed), lambda stage, part:
                           bar.update(task, description=stage, completed=part))
    scene, pose_s = run.estimate, run.seconds['pose']
    evidence_s = run.seconds['views'] + run.seconds['evidence']
    if as_json:
        timings = {'dlv': 1e3 * evidence_s, 'pmcl': 1e3 * pose_s}
        click.echo(json.dumps(scene.as_dict() | {'timings_ms': timings}))
    else:
        click.echo(scene.describe())
        click.echo(f'dlv {evidence_s:.2f} s, pmcl {pose_s:.2f} s', err=True)
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
        there = [(model, each.pose, name) for model, each, name
                 in zip(models, scene.estimates, scene.names, strict=True) if not each.lost]
        picture = outlines(run.light_field.picture(), run.light_field.grid.pinhole, there)
        write_png(out / 'overlay.png', picture)
        click.echo(f'picture in {out}', err=True)
