"""`pmcl localize` with several objects."""

import json
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import click
import numpy as np
from rich.progress import Progress

from pmcl_ros.cli.base import STDERR
from pmcl_ros.dlv.build import build_volume
from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.drawing.pictures import outlines, write_png
from pmcl_ros.evaluation.variants import volume_settings
from pmcl_ros.lightfield.light_field import LightField
from pmcl_ros.pmcl.multi_object.scene_localizer import SceneLocalizer
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.region import Region
from pmcl_ros.pmcl.settings import PmclSettings


def localize_several(read: Callable[[], LightField], objects: Sequence[Path],
                     settings: PmclSettings, of_volume: dict[str, object], as_json: bool,
                     out: Path | None) -> None:
    """Find objects together in a light field, tell where they are, and draw their outlines.

    objects: meshes or object YAMLs; one that is there twice: two copies.
    """
    loaded = {each: ObjectModel.load(each) for each in dict.fromkeys(objects)}
    models = [loaded[each] for each in objects]
    region = Region(settings.roi_center, settings.roi_size)
    near, far = region.grown(max(each.radius for each in models))
    with (Progress(console=STDERR, transient=True) as bar,
          SceneLocalizer(models, settings) as localizer):
        task = bar.add_task('volume', total=1.0)
        started = time.perf_counter()
        light_field = read()
        wanted = volume_settings(settings.mode, near, far, light_field.grid)
        volume = build_volume(light_field, DlvSettings.make(wanted.model_dump() | of_volume,
                                                            '--set'))
        built = time.perf_counter()
        bar.update(task, description='poses')

        def show(part: float) -> bool:
            bar.update(task, completed=part)
            return True

        scene = localizer.localize(volume, np.random.default_rng(settings.seed), show)
        found = time.perf_counter()
    if as_json:
        timings = {'dlv': 1e3 * (built - started), 'pmcl': 1e3 * (found - built)}
        click.echo(json.dumps(scene.as_dict() | {'timings_ms': timings}))
    else:
        click.echo(scene.describe())
        click.echo(f'dlv {built - started:.2f} s, pmcl {found - built:.2f} s', err=True)
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
        there = [(model, each.pose, name) for model, each, name
                 in zip(models, scene.estimates, scene.names, strict=True) if not each.lost]
        picture = outlines(light_field.picture(), light_field.grid.pinhole, there)
        write_png(out / 'overlay.png', picture)
        click.echo(f'picture in {out}', err=True)
