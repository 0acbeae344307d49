"""`pmcl report`: localises an object and writes a page about it."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import click
from rich.progress import Progress

from pmcl_ros.camera.files import is_picture, read_metadata
from pmcl_ros.cli.base import FILE, STDERR
from pmcl_ros.cli.sources import open_decoders, open_source, source_options
from pmcl_ros.evaluation.report.localization import localize
from pmcl_ros.evaluation.report.page import page
from pmcl_ros.geometry.truth import Truth
from pmcl_ros.lightfield.calibration.calibration import Calibration
from pmcl_ros.lightfield.light_field import LightField
from pmcl_ros.lightfield.readers.read import Source, has_posed_views
from pmcl_ros.messages.bag_captures import read_bag
from pmcl_ros.messages.bags import is_bag
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.settings import PmclSettings
from pmcl_ros.runtime.errors import PmclError, SettingsError
from pmcl_ros.runtime.resources import resolve
from pmcl_ros.runtime.settings import read_yaml

_CONFIG = 'package://pmcl_ros/config/pmcl.yaml'


@click.command()
@source_options
@click.option('--object', 'object_path', type=FILE, help='A mesh in metres, or an object YAML; '
              'default: model.obj beside SOURCE, or models/NAME.obj of a bag NAME.')
@click.option('--roi', type=float, nargs=6, metavar='CX CY CZ SX SY SZ', help="Box that holds the "
              "object's origin [m]; default: that of truth.json.")
@click.option('--mode', type=click.Choice(['default', 'faithful']), default='default',
              show_default=True, help=PmclSettings.model_fields['mode'].description)
@click.option('--seed', type=click.IntRange(0), default=0, show_default=True,
              help='The same seed gives the same pose.')
@click.option('--truth', 'truth_path', type=FILE, help='A truth.json to compare with; default: '
              'the one beside SOURCE, if there is one and no other --object is looked for.')
@click.option('-o', '--out', type=click.Path(dir_okay=False, path_type=Path),
              default=Path('report.html'), show_default=True, help='The page, one HTML file.')
def report(source: Path, calibration: Path | None, white: Path | None, every: int, shrink: int,
           scale: float | None, distance: tuple[str, str, float] | None,
           object_path: Path | None, roi: tuple[float, ...] | None, mode: str, seed: int,
           truth_path: Path | None, out: Path) -> None:
    """Find the object's pose in SOURCE and write a page about it.

    SOURCE is a bag of raw pictures or of views (its first capture), or what `pmcl localize` takes.
    For a bag, --calibration and --white are by default those of config/pmcl.yaml.
    """
    folder = source if source.is_dir() else source.parent
    beside = folder / 'truth.json' if (folder / 'truth.json').is_file() else None
    known = truth_path or beside
    truth = Truth.load(known) if known else None
    center, size = _region(roi, truth)
    if object_path is not None and truth_path is None:
        truth = None  # it is of the object in the picture, which may be another one
    object_path = object_path or _object(source, folder)
    settings = PmclSettings.make({'mode': mode, 'object': str(object_path), 'seed': seed,
                                  'roi_center': center, 'roi_size': size}, '--roi, --mode, --seed')
    model = ObjectModel.load(object_path)
    with Progress(console=STDERR, transient=True) as bar:
        task = bar.add_task('reading', total=1.0)
        read, serial = _open(source, calibration, white, every, shrink, scale, distance)
        run = localize(read, model, settings, lambda stage, part: bar.update(
            task, description=stage, completed=part), str(source), serial, truth,
            has_posed_views(source))
        bar.update(task, description='page')
        text = page(run)
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        out.write_text(text, encoding='utf-8')
    except OSError as error:
        raise PmclError(f'cannot write {out}: {error.strerror or error}') from None
    STDERR.print(run.estimate.describe(), markup=False, soft_wrap=True)
    click.echo(out)


def _region(roi: tuple[float, ...] | None, truth: Truth | None
            ) -> tuple[tuple[float, ...], tuple[float, ...]]:
    if roi:
        return roi[:3], roi[3:]
    if truth is None:
        raise click.UsageError('the region of interest is unknown: there is no truth.json beside '
                               'the source; give --roi')
    return truth.roi_center, truth.roi_size


def _object(source: Path, folder: Path) -> Path:
    if (folder / 'model.obj').is_file():
        return folder / 'model.obj'
    if is_bag(source):
        try:
            return resolve(f'package://pmcl_ros/models/{source.resolve().name}.obj', 'object')
        except SettingsError:
            pass
    raise click.UsageError('the object is unknown: there is no model.obj beside the source; give '
                           '--object')


def _open(source: Path, calibration: Path | None, white: Path | None, every: int, shrink: int,
          scale: float | None, distance: tuple[str, str, float] | None
          ) -> tuple[Callable[[], Source], str]:
    """A function that makes or reads the source, and the camera's serial number, if known."""
    if not is_bag(source):
        serial = read_metadata(source).serial if is_picture(source) else ''
        return open_source(source, calibration, white, every, shrink, scale, distance), serial
    if (every, shrink) != (1, 1):
        raise click.UsageError(f'{source} is a bag: --every and --shrink are for light fields')
    capture = read_bag(source)
    if isinstance(capture, LightField):
        return lambda: capture, ''
    decoders = open_decoders(Calibration.load(calibration or _configured('calibration')),
                             white or _configured('white'))
    decoders.decoder_for(capture.metadata)
    return partial(decoders.decode, capture), capture.metadata.serial


def _configured(name: str) -> Path:
    """The value of a parameter of subaperture_node in config/pmcl.yaml."""
    path = resolve(_CONFIG, 'config')
    try:
        value: Any = read_yaml(path)['/**/subaperture_node']['ros__parameters'][name]
    except (KeyError, TypeError):
        raise SettingsError(f'{path} names no {name} of subaperture_node; give --{name}') from None
    return resolve(str(value), name)
