"""`pmcl learn-map`, `measure-map`: train the network of the contour map, measure what it finds."""

from pathlib import Path

import click
from rich.progress import Progress

from pmcl_ros.cli.base import FILE, FOLDER, FORCE, STDERR, results_in
from pmcl_ros.evidence.contour_net import ContourNet, contour_net
from pmcl_ros.evidence.learned import LearnedMap
from pmcl_ros.learning.contour_net.calibration import Measured
from pmcl_ros.learning.contour_net.pictures import labelled_files
from pmcl_ros.learning.contour_net.training_plan import TrainingPlan


@click.command()
@click.argument('pictures', type=FOLDER)
@click.option('-o', '--out', type=FOLDER, required=True, help='Folder of what is made: '
              'contour_map.onnx, contour_map.yaml, reliability.png, and training.npz, from which '
              'training goes on.')
@click.option('--steps', type=click.IntRange(1), default=TrainingPlan.steps, show_default=True)
@click.option('--seed', type=click.IntRange(0), default=TrainingPlan.seed, show_default=True)
@click.option('--batch', type=click.IntRange(1), default=TrainingPlan.size, show_default=True,
              help='Crops of a step.')
@click.option('--crop', type=click.IntRange(32), default=TrainingPlan.crop, show_default=True,
              help='Side of a crop [px], a multiple of 16.')
@click.option('--every', type=click.IntRange(1), default=TrainingPlan.every, show_default=True,
              help='Steps between two lines and two states on disk.')
@click.option('--bfloat16', is_flag=True, help='Compute layers in bfloat16: faster where the '
              'processor or the GPU has it.')
@click.option('--width', type=click.FloatRange(0.25, 4), default=TrainingPlan.width,
              show_default=True, help="Channels of the network's layers, as a share of those of "
              'the shipped one.')
@click.option('--start', type=FILE, help='Network to begin with: a contour_map.onnx, for '
              'example the shipped one. Default: random weights.')
@click.option('--rate', type=click.FloatRange(1e-7, 1), default=TrainingPlan.rate,
              show_default=True, help='Learning rate; less with --start, for example 0.0001.')
@FORCE
def learn_map(pictures: Path, out: Path, steps: int, seed: int, batch: int, crop: int, every: int,
              bfloat16: bool, width: float, start: Path | None, rate: float, force: bool) -> None:
    """Train the network of the contour map on labelled pictures, and calibrate it.

    Needs TensorFlow: pip install '.[learn]' in the source tree. It uses a GPU where it sees one.
    Some pictures are held out, by their seeds.
    """
    if crop % 16:
        raise click.BadParameter(f'{crop} is no multiple of 16', param_hint='--crop')
    results_in(out, force).reserve('contour_map.onnx', 'contour_map.yaml', 'reliability.png',
                                   'training.npz')
    try:
        from pmcl_ros.learning.contour_net.learn import learn
    except ModuleNotFoundError as error:
        raise click.ClickException(
            f"there is no {error.name} here; pip install '.[learn]' in the source tree") from error
    command = (f'pmcl learn-map {pictures} -o {out} --steps {steps} --seed {seed} --batch {batch} '
               f'--crop {crop}{" --bfloat16" * bfloat16}'
               f'{f" --width {width:g}" if width != TrainingPlan.width else ""}'
               f'{f" --start {start}" if start else ""}'
               f'{f" --rate {rate}" if rate != TrainingPlan.rate else ""}')
    plan = TrainingPlan(steps, seed, batch, crop, every,
                        'mixed_bfloat16' if bfloat16 else 'float32', rate, width)
    learned = learn(pictures, out, plan, command, click.echo, start)
    click.echo(f'contour: {learned.contour}')
    click.echo(f'inside: {learned.inside}')


@click.command()
@click.argument('pictures', type=FOLDER)
@click.option('--map', 'made', type=FOLDER, show_default='those that the package ships',
              help='Folder of contour_map.onnx and contour_map.yaml.')
def measure_map(pictures: Path, made: Path | None) -> None:
    """Measure what a network of the contour map finds in labelled pictures.

    Choose pictures of other seeds than those it was trained on.
    """
    net = contour_net() if made is None else ContourNet(
        made / 'contour_map.onnx', LearnedMap.load(made / 'contour_map.yaml'))
    files = labelled_files(pictures)
    with Progress(console=STDERR, transient=True) as bar:
        measured = Measured.measure(net.logits, bar.track(files))
    click.echo(f'network {net.learned.version}, {len(files)} pictures')
    for name, value in measured.results(net.learned.contour, net.learned.inside).items():
        click.echo(f'{name.replace("_", " ")}: {value}')
