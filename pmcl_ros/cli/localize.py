"""`pmcl localize`: the pose of an object, or of several, from one picture."""

from dataclasses import replace
from pathlib import Path

import click

from pmcl_ros.cli.base import FOLDER, FORCE, MODE, OBJECT, STDERR, TRUTH, results_in
from pmcl_ros.cli.localization import Request, localize_each, localize_one, localize_several
from pmcl_ros.cli.objects import OBJECT_ID, objects_of
from pmcl_ros.cli.region import GivenRegion, region_options
from pmcl_ros.cli.sources import GivenSource, Search, source_options
from pmcl_ros.evaluation.variants import Variant
from pmcl_ros.lightfield.readers.read import pictures_alone
from pmcl_ros.pmcl.settings import EvidenceKind, Mode, PmclSettings


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
@click.option('-o', '--out', type=FOLDER, help='Folder for pictures.')
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
    folder with it, a transforms.json, the folder of a COLMAP model or of a BOP scene, or a
    picture of one. With poses of the cameras, the region and the pose are in their reference
    frame. A bag is one of raw pictures, of views, of posed views, or a robot's of images,
    camera_info and poses.
    """
    results = None if out is None else results_in(out, force)
    objects, load = objects_of(source.source, objects, object_id)
    changed = _changed(changes)
    chosen = {} if kind is None else {'evidence': kind}
    settings = PmclSettings.make({'mode': mode, 'object': str(objects[0]), 'seed': seed}
                                 | region.settings() | chosen | dict(changed.pmcl),
                                 '--roi, --depths, --table, --tilt, --up, --mode, --evidence, '
                                 '--set, --seed')
    request = Request(settings, dict(changed.dlv), as_json, results)
    search = Search(mode, settings.evidence, results is not None and len(objects) == 1)
    alone = pictures_alone(source.source)
    if alone:
        if len(objects) > 1 or truth is not None:
            raise click.UsageError(f'{source.source} has no camera poses, and each picture is '
                                   'localised alone: give one --object, and no --truth')
        STDERR.print('no camera poses: each picture is localised alone', markup=False)
        search.compile_kernels(pictures=True)
        localize_each([replace(source, source=each) for each in alone], load(objects[0]), request)
        return
    opened = source.open(search)
    if results is not None and not opened.posed:  # of posed views the number is not known yet
        results.reserve('overlay.png', *(['centre.png'] if len(objects) == 1 else []))
    if len(objects) == 1:
        localize_one(opened, load(objects[0]), request, truth)
        return
    if truth is not None:
        raise click.UsageError('--truth is of one object: give one --object')
    localize_several(opened, objects, request)


def _changed(changes: tuple[str, ...]) -> Variant:
    """The values of --set; UsageError where they name another row."""
    changed = Variant.parse(','.join(changes)) if changes else Variant.named('default')
    if changed.base != 'default':
        raise click.UsageError(f'--set {" ".join(changes)}: there are no rows here; say --mode')
    return changed
