"""`pmcl report`: localises an object and writes a page about it."""

from dataclasses import replace
from pathlib import Path

import click
from rich.progress import Progress

from pmcl_ros.cli.base import FORCE, MODE, OBJECT, STDERR, TRUTH, results_in
from pmcl_ros.cli.objects import OBJECT_ID, objects_of
from pmcl_ros.cli.region import GivenRegion, region_options, settled
from pmcl_ros.cli.sources import GivenSource, Search, source_options
from pmcl_ros.evaluation.report.localization import Localization, localize
from pmcl_ros.evaluation.report.page import page
from pmcl_ros.geometry.truth import Truth
from pmcl_ros.lightfield.readers.read import pictures_alone
from pmcl_ros.messages.bags import is_bag
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.settings import PmclSettings
from pmcl_ros.runtime.errors import SettingsError
from pmcl_ros.runtime.outputs import write_file
from pmcl_ros.runtime.resources import resolve


@click.command()
@source_options
@click.option('--object', 'object_path', type=OBJECT, help='A mesh, or an object YAML; '
              'default: model.yaml or model.obj beside SOURCE, or models/NAME.obj of a bag NAME.')
@OBJECT_ID
@region_options
@MODE
@click.option('--seed', type=click.IntRange(0), default=0, show_default=True,
              help='The same seed gives the same pose.')
@click.option('--truth', 'truth_path', type=TRUTH, help='A truth.json to compare with; default: '
              'the one beside SOURCE, if there is one and no other --object is looked for.')
@click.option('-o', '--out', type=click.Path(dir_okay=False, path_type=Path),
              default=Path('report.html'), show_default=True, help='The page, one HTML file.')
@FORCE
def report(source: GivenSource, object_path: Path | None, object_id: int | None,
           region: GivenRegion, mode: str, seed: int, truth_path: Path | None, out: Path,
           force: bool) -> None:
    """Find the object's pose in SOURCE and write a page about it.

    SOURCE is what `pmcl localize` takes. Without --roi, --depths or --table the region is that of
    the truth.json beside it. Of a BOP scene without camera poses the page is of the first picture;
    another one is named as SOURCE.
    """
    written = results_in(out.parent, force).path(out.name)
    path = source.source
    folder = path if path.is_dir() else path.parent
    known = truth_path or _truth_beside(folder)
    truth = Truth.load(known) if known else None
    where = (region.settings() if region.is_placed or truth is None else
             {'roi_center': truth.roi_center, 'roi_size': truth.roi_size}
             | region.orientation)
    if object_path is None and object_id is None:
        object_path = _object_beside(path, folder)
    elif truth_path is None:
        truth = None  # it is of the object in the picture, which may be another one
    (object_path,), load = objects_of(path, () if object_path is None else (object_path,),
                                      object_id)
    settings = PmclSettings.make({'mode': mode, 'object': str(object_path), 'seed': seed}
                                 | where, '--roi, --depths, --table, --tilt, --up, --mode, --seed')
    model = load(object_path)
    alone = pictures_alone(path)
    if alone:
        source = replace(source, source=alone[0])
        STDERR.print(f'no camera poses: the report is of {source.source} alone', markup=False,
                     soft_wrap=True)
    run, text = _localized(source, model, settings, truth)
    write_file(written, text)
    STDERR.print(run.in_reference.describe(), markup=False, soft_wrap=True)
    click.echo(out)


def _localized(source: GivenSource, model: ObjectModel, settings: PmclSettings,
               truth: Truth | None) -> tuple[Localization, str]:
    """What was found, and the page about it, with a progress bar."""
    opened = source.open(Search(settings.mode, settings.evidence, with_volume=True))
    with Progress(console=STDERR, transient=True) as bar:
        task = bar.add_task('reading', total=1.0)
        settings, read = settled(settings, opened.read, model.radius)
        run = localize(read, model, settings, lambda stage, part: bar.update(
            task, description=stage, completed=part), str(source.source), opened.serial, truth,
            opened.posed)
        bar.update(task, description='page')
        return run, page(run)


def _truth_beside(folder: Path) -> Path | None:
    file = folder / 'truth.json'
    return file if file.is_file() else None


def _object_beside(source: Path, folder: Path) -> Path:
    for name in ('model.yaml', 'model.obj'):
        if (folder / name).is_file():
            return folder / name
    if is_bag(source):
        try:
            return resolve(f'package://pmcl_ros/models/{source.resolve().name}.obj', 'object')
        except SettingsError:
            pass
    raise click.UsageError('the object is unknown: there is no model.obj beside the source; give '
                           '--object, or --object-id of a BOP scene')
