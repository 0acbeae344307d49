"""`pmcl track`: tracking through generated sequences, compared with single captures."""

from pathlib import Path

import click
from rich.progress import MofNCompleteColumn, Progress, TimeRemainingColumn

from pmcl_ros.cli.base import FOLDER, STDERR
from pmcl_ros.drawing.pictures import write_png
from pmcl_ros.evaluation.results import table
from pmcl_ros.evaluation.studies.tracking import (
    TRACKED,
    picture,
    play,
    recoveries,
    recovery,
    row,
)
from pmcl_ros.evaluation.trials import Trial
from pmcl_ros.pmcl.tracking.settings import TrackingSettings
from pmcl_ros.simulation.sequence import Sequence, SequenceSettings

_FIELDS = SequenceSettings.model_fields


@click.command()
@click.option('--count', type=click.IntRange(1), default=3, show_default=True, help='Sequences.')
@click.option('--seed', type=click.IntRange(0), default=0, show_default=True,
              help='Sequence k is that of seed + k.')
@click.option('--model', type=click.Choice(['constant_pose', 'constant_velocity', 'camera']),
              default='constant_velocity', show_default=True,
              help=TrackingSettings.model_fields['tracking'].description)
@click.option('--every', type=click.IntRange(0), default=4, show_default=True, metavar='N',
              help='Localise each N-th frame by itself too; 0: none.')
@click.option('--frames', type=click.IntRange(1), default=_FIELDS['frames'].default,
              show_default=True, help=_FIELDS['frames'].description)
@click.option('--occluded', type=click.IntRange(0), show_default=True,
              default=_FIELDS['occluded'].default, help=_FIELDS['occluded'].description)
@click.option('--size', type=click.IntRange(32), default=_FIELDS['size'].default,
              show_default=True, help=_FIELDS['size'].description)
@click.option('--object-speed', type=click.FloatRange(0), show_default=True,
              default=_FIELDS['object_speed'].default, help=_FIELDS['object_speed'].description)
@click.option('--camera-speed', type=click.FloatRange(0), show_default=True,
              default=_FIELDS['camera_speed'].default, help=_FIELDS['camera_speed'].description)
@click.option('--out', type=FOLDER, help='Folder for the table (track.md) and a drawing of the '
              'errors over frames for each sequence.')
def track(count: int, seed: int, model: str, every: int, frames: int, occluded: int,
          size: int, object_speed: float, camera_speed: float, out: Path | None) -> None:
    """Track an object through generated sequences (`pmcl scenes sequence`); print the errors.

    Errors, shares and times of single shots are of the frames that were localised both ways.
    """
    settings = SequenceSettings.make(
        {'frames': frames, 'occluded': occluded, 'size': size, 'object_speed': object_speed,
         'camera_speed': camera_speed}, 'pmcl track')
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
    rows: list[dict[str, str]] = []
    played: list[list[Trial]] = []
    columns = (*Progress.get_default_columns()[:3], MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=STDERR, transient=True) as bar:
        task = bar.add_task('', total=count * frames)
        for number in range(seed, seed + count):
            sequence = Sequence(number, settings)
            name = f'{number}: {sequence.kind} {sequence.model.name}'
            bar.update(task, description=name)
            trials: list[Trial] = []
            for each in play(sequence, model, every):  # type: ignore[arg-type]
                trials.append(each)
                bar.update(task, advance=each.mode == TRACKED)
            played.append(trials)
            rows.append(row(name, [trials]))
            shown = [*rows, row('all', played)]
            text = '\n\n'.join([table(list(shown[0]), [list(line.values()) for line in shown]),
                                recoveries([recovery(each) for each in played])])
            if out is not None:  # at once: a sequence takes minutes
                write_png(out / f'track_{number:03d}.png', picture(name, trials))
                (out / 'track.md').write_text(text + '\n')
    click.echo(text)
