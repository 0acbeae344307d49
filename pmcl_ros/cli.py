"""`pmcl ...`: the same core as the nodes, without ROS."""

import json
import logging
import sys
import time
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import click
import numpy as np
from rich.console import Console
from rich.logging import RichHandler
from rich.progress import Progress

from pmcl_ros import __version__
from pmcl_ros.bags import record_capture
from pmcl_ros.camera.files import list_pictures, read_raw_frame
from pmcl_ros.dlv.build import build_volume
from pmcl_ros.errors import PmclError
from pmcl_ros.evaluation.bench import bench_dlv
from pmcl_ros.evaluation.errors import pose_error
from pmcl_ros.evaluation.pictures import depth_picture, overlay, write_png
from pmcl_ros.evaluation.trials import (
    Trial,
    find_captures,
    markdown,
    run_trials,
    volume_settings,
    write_csv,
)
from pmcl_ros.evaluation.truth import Truth
from pmcl_ros.lightfield.calibration import Calibration
from pmcl_ros.lightfield.decode import Decoder
from pmcl_ros.pmcl.localizer import Localizer
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.region import Region
from pmcl_ros.pmcl.settings import PmclSettings

_STDERR = Console(stderr=True)
_FILE = click.Path(exists=True, dir_okay=False, path_type=Path)
_FOLDER = click.Path(file_okay=False, path_type=Path)


class _Commands(click.Group):
    """Turns the package's errors into one line and exit status 1."""

    def invoke(self, ctx: click.Context) -> Any:
        try:
            return super().invoke(ctx)
        except PmclError as error:
            raise click.ClickException(str(error)) from error


@click.group(cls=_Commands)
@click.version_option(__version__)
@click.option('--verbose', is_flag=True, help='Say what is chosen (renderer, symmetry, ...).')
def main(verbose: bool) -> None:
    """Where a transparent object is, from a light field."""
    logging.basicConfig(level=logging.INFO if verbose else logging.WARNING, format='%(message)s',
                        handlers=[RichHandler(console=_STDERR, show_path=False)])


def _capture_options(command: Callable[..., None]) -> Callable[..., None]:
    for option in (
            click.argument('raw', type=_FILE),
            click.option('--calibration', required=True, type=_FILE,
                         help="The camera's calibration, YAML."),
            click.option('--white', required=True, type=_FILE,
                         help="The camera's white image, RAW[.xz] with its TXT.")):
        command = option(command)
    return command


@main.command()
@_capture_options
@click.option('--out', required=True, type=_FOLDER, help='Folder for views.npz and pictures.')
def decode(raw: Path, calibration: Path, white: Path, out: Path) -> None:
    """Decode RAW (.RAW or .RAW.xz with its .TXT) into rectified views: NPZ and PNG."""
    decoder = Decoder(Calibration.load(calibration), read_raw_frame(white))
    light_field = decoder.decode(read_raw_frame(raw))
    out.mkdir(parents=True, exist_ok=True)
    pinhole = light_field.grid.pinhole
    np.savez_compressed(out / 'views.npz', views=light_field.views, fx=pinhole.fx, fy=pinhole.fy,
                        cx=pinhole.cx, cy=pinhole.cy, baseline=light_field.grid.baseline,
                        weights=light_field.grid.weights, positions=light_field.grid.positions)
    write_png(out / 'centre.png', light_field.picture())
    rows, columns = light_field.grid.shape
    shown = np.clip(light_field.views[:, :, ::3, ::3], 0, 1) ** light_field.gamma
    mosaic = shown.transpose(0, 2, 1, 3, 4).reshape(rows * shown.shape[2],
                                                    columns * shown.shape[3], 3)
    write_png(out / 'views.png', np.round(255 * mosaic).astype(np.uint8))
    click.echo(f'{rows}x{columns} views of {pinhole.width}x{pinhole.height} in {out}', err=True)


@main.command()
@_capture_options
@click.option('--object', 'object_path', required=True, type=_FILE,
              help='A mesh in metres, or an object YAML.')
@click.option('--roi', required=True, type=float, nargs=6, metavar='CX CY CZ SX SY SZ',
              help="Box that holds the object's origin: centre and size, camera's optical frame "
              '[m].')
@click.option('--mode', type=click.Choice(['default', 'faithful']), default='default',
              show_default=True, help=PmclSettings.model_fields['mode'].description)
@click.option('--seed', type=click.IntRange(0), default=0, show_default=True,
              help='The same seed gives the same pose.')
@click.option('--json', 'as_json', is_flag=True, help='Print one JSON object on standard output.')
@click.option('--out', type=_FOLDER, help='Folder for pictures.')
@click.option('--truth', type=_FILE, help='A truth.json to compare with.')
def localize(raw: Path, calibration: Path, white: Path, object_path: Path,
             roi: tuple[float, ...], mode: str, seed: int, as_json: bool, out: Path | None,
             truth: Path | None) -> None:
    """Find the object's pose in RAW (.RAW or .RAW.xz with its .TXT)."""
    settings = PmclSettings.make({'mode': mode, 'object': str(object_path), 'seed': seed,
                                  'roi_center': roi[:3], 'roi_size': roi[3:]},
                                 '--roi, --mode, --seed')
    model = ObjectModel.load(object_path)
    near, far = Region(settings.roi_center, settings.roi_size).grown(model.radius)
    decoder = Decoder(Calibration.load(calibration), read_raw_frame(white))
    frame = read_raw_frame(raw)
    with Progress(console=_STDERR, transient=True) as bar, Localizer(model, settings) as localizer:
        task = bar.add_task('views', total=1.0)
        started = time.perf_counter()
        light_field = decoder.decode(frame)
        decoded = time.perf_counter()
        bar.update(task, description='volume')
        volume = build_volume(light_field, volume_settings(settings.mode, near, far))
        built = time.perf_counter()
        bar.update(task, description='pose')

        def show(part: float) -> bool:
            bar.update(task, completed=part)
            return True

        estimate = localizer.localize(volume, np.random.default_rng(seed), show)
        found = time.perf_counter()
    times = {'decode': decoded - started, 'dlv': built - decoded, 'pmcl': found - built}
    if as_json:
        timings = {name: 1e3 * each for name, each in times.items()}
        click.echo(json.dumps(estimate.as_dict() | {'timings_ms': timings}))
    else:
        click.echo(estimate.describe())
        click.echo(', '.join(f'{name} {each:.2f} s' for name, each in times.items()), err=True)
    if truth is not None:
        error = pose_error(estimate.pose, Truth.load(truth).pose, model.axis)
        click.echo(f'off by {1e3 * error.translation:.1f} mm and '
                   f'{np.rad2deg(error.rotation):.1f} degrees', err=True)
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
        picture = light_field.picture()
        write_png(out / 'centre.png', picture)
        write_png(out / 'depth.png', depth_picture(volume.depth_map(), near, far))
        write_png(out / 'overlay.png', overlay(picture, volume.pinhole, model, estimate.pose))
        click.echo(f'pictures in {out}', err=True)


@main.command('calibration-from-truth')
@click.argument('capture', type=_FILE)
@click.argument('white', type=_FILE)
@click.option('--serial', default='', help='Serial number of the camera.')
@click.option('--out', required=True, type=click.Path(dir_okay=False, path_type=Path))
def calibration_from_truth(capture: Path, white: Path, serial: str, out: Path) -> None:
    """Write the calibration of simulated captures from their truth.json files.

    That of a CAPTURE and that of the WHITE image.
    """
    Calibration.from_truth(capture, white, serial).save(
        out, "Of a simulated camera, from its captures' truth files "
        '(pmcl calibration-from-truth).')


@main.command()
@click.argument('captures', type=click.Path(exists=True, file_okay=False, path_type=Path))
@click.option('--calibration', required=True, type=_FILE, help='Calibration of the camera, YAML.')
@click.option('--white', type=_FILE, help='White image; default: the one in CAPTURES/white.')
@click.option('--modes', default='default', show_default=True, help='Modes, separated by commas.')
@click.option('--trials', type=click.IntRange(1), default=10, show_default=True, help='Seeds.')
@click.option('--only', multiple=True, metavar='NAME', help='Only this capture.')
@click.option('--out', type=_FOLDER, help='Folder for results.csv and results.md.')
def evaluate(captures: Path, calibration: Path, white: Path | None, modes: str, trials: int,
             only: tuple[str, ...], out: Path | None) -> None:
    """Localise CAPTURES (subfolders with a picture, model.obj, truth.json), and tell errors."""
    decoder = Decoder(Calibration.load(calibration),
                      read_raw_frame(white or list_pictures(captures / 'white')[0]))
    folders = [each for each in find_captures(captures) if not only or each.name in only]
    results: list[Trial] = []
    with Progress(console=_STDERR, transient=True) as bar:
        names = [PmclSettings.make({'mode': mode}, '--modes').mode for mode in modes.split(',')]
        task = bar.add_task('', total=len(folders) * len(names) * trials)
        for mode in names:
            for folder in folders:
                bar.update(task, description=f'{folder.name}, {mode}')
                for trial in run_trials(folder, decoder, mode, range(trials)):
                    results.append(trial)
                    bar.advance(task)
    table = markdown(results)
    click.echo(table)
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
        write_csv(out / 'results.csv', results)
        (out / 'results.md').write_text(table + '\n')


@main.command()
@click.argument('name', type=click.Choice(['dlv']))
@click.option('--json', 'as_json', is_flag=True, help='Print one JSON object.')
def bench(name: str, as_json: bool) -> None:
    """Time a stage against its plain form, run beside it."""
    result = {'dlv': bench_dlv}[name]()
    if as_json:
        click.echo(json.dumps(asdict(result)))
        return
    click.echo(result.geometry)
    for step, milliseconds in result.ms.items():
        click.echo(f'{step:>16}: {milliseconds:9.1f} ms')
    click.echo(f'{result.ratio_to_reference:.0f} times as fast as the plain form')


@main.group()
def bag() -> None:
    """MCAP bags of the topics between the nodes."""


@bag.command('record')
@click.argument('raw', type=_FILE)
@click.argument('folder', type=_FOLDER)
def bag_record(raw: Path, folder: Path) -> None:
    """Make the bag FOLDER from RAW: what lytro_driver would publish for it."""
    record_capture(raw, folder)


if __name__ == '__main__':
    sys.exit(main())
