"""Opens a source: a raw picture with its camera, views, ordinary pictures, or a bag of these."""

import math
from collections.abc import Callable, Collection
from dataclasses import dataclass, fields
from functools import partial, wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import click

from pmcl_ros.camera.files import read_raw_frame
from pmcl_ros.camera.raw_frame import RawFrame
from pmcl_ros.cli.base import (
    FILE,
    OF_CAMERA,
    SOURCE,
    STDERR,
    WHITE,
    calibration_type,
    with_options,
)
from pmcl_ros.lightfield.calibration.lytro.calibration import Calibration
from pmcl_ros.lightfield.decode import VIEWS
from pmcl_ros.lightfield.decoders import Decoders
from pmcl_ros.lightfield.posed_view import PosedViews, PoseErrors
from pmcl_ros.lightfield.readers.metric import Metric
from pmcl_ros.lightfield.readers.read import (
    Source,
    check_folder,
    has_pictures,
    has_posed_views,
    has_scale,
    is_colmap,
    is_light_field,
)
from pmcl_ros.messages.bag_views import BagViews
from pmcl_ros.messages.bags import is_bag
from pmcl_ros.reading import Reading
from pmcl_ros.runtime.errors import LightFieldError, SettingsError
from pmcl_ros.runtime.resources import resolve
from pmcl_ros.runtime.settings import read_yaml
from pmcl_ros.warm_up.raw import DECODE
from pmcl_ros.warm_up.stage import compile_ahead

if TYPE_CHECKING:
    from pmcl_ros.pmcl.settings import EvidenceKind, Mode
    from pmcl_ros.warm_up.stage import Stages

PICTURE_SUFFIXES = ('.png', '.jpg', '.jpeg', '.tif', '.tiff', '.bmp', '.webp')
_OF_BAGS = ('.mcap', '.db3')
_CONFIG = 'package://pmcl_ros/config/pmcl.yaml'
_OF_RAW = (
    click.option('--calibration', type=calibration_type, metavar='FILE|NAME',
                 help="For a raw picture: the camera's calibration, a YAML file or the name given "
                 'to pmcl calibrate --camera.'),
    click.option('--white', type=WHITE, help="For a raw picture: the camera's white image "
                 '(RAW[.xz] with its TXT), or a folder of white images, from which the one that '
                 'fits the picture is chosen.'))
_OF_READING = (
    click.option('--every', type=click.IntRange(1), default=1, metavar='K',
                 help='For a light field or ordinary pictures: read only each K-th view.'),
    click.option('--shrink', type=click.IntRange(1), default=1, metavar='N',
                 help='For a light field or ordinary pictures: average NxN pixels into one.'),
    click.option('--scale', type=click.FloatRange(0, min_open=True), metavar='METRES',
                 help='For a COLMAP model or a transforms.json without metric scale: metres per '
                 'unit.'),
    click.option('--distance', type=(str, str, click.FloatRange(0, min_open=True)),
                 metavar='NAME NAME METRES', help='In place of --scale: two pictures, and the '
                 'distance between their cameras.'),
    click.option('--masks', type=click.Path(exists=True, path_type=Path), metavar='PATH',
                 help='For a COLMAP model: folder with the mask NAME.png of each picture NAME, or '
                 'a picture that is the mask of all. What is black there is no evidence.'),
    click.option('--image-topic', metavar='TOPIC', help="For a robot's bag: "
                 + (BagViews.model_fields['image_topic'].description or '')),
    click.option('--pose-topic', metavar='TOPIC', help="For a robot's bag: "
                 + (BagViews.model_fields['pose_topic'].description or '')),
    click.option('--collect', type=FILE, help="For a robot's bag: YAML file with parameters of "
                 'sweep_driver (near, gap, mount_position, fixed_frame, ...).'))
_OF_POSES = (
    click.option('--sigma-mm', type=click.FloatRange(0, 1e4), metavar='MM', help='For posed '
                 'views: standard deviation of the position of each camera pose, on each axis. It '
                 'replaces sigma_mm of views.yaml. A COLMAP model, a transforms.json and a BOP '
                 'scene state none: the default is 0 there.'),
    click.option('--sigma-deg', type=click.FloatRange(0, 180), metavar='DEG', help='For posed '
                 'views: the same of the rotation, about each axis.'),
    click.option('--common', type=click.FloatRange(0, 1), metavar='SHARE', help='For posed views: '
                 'share of the variances of --sigma-mm and --sigma-deg that all views have in '
                 'common. Default: that of SOURCE, else 0.'))


class Opened(NamedTuple):
    """What makes or reads the source.

    pictures: of ordinary cameras. posed: it is `PosedViews`. scaled: by --scale or --distance.
    serial: of a Lytro.
    """

    read: Callable[[], Source]
    pictures: bool = False
    posed: bool = False
    scaled: bool = False
    serial: str = ''


class Search(NamedTuple):
    """What a command does with its source.

    evidence: as of `PmclSettings`. with_volume: it makes the volume, too.
    """

    mode: 'Mode' = 'default'
    evidence: 'EvidenceKind' = 'auto'
    with_volume: bool = False

    def compile_kernels(self, raw: bool = False, pictures: bool = False, posed: bool = False,
                        also: 'Stages' = ()) -> None:
        """Compile the kernels for a source, where they are not on disk, with a progress line.

        raw, pictures, posed: kind of the source, as of `Opened`. also: what else the command
        needs. Raises VolumeError for pictures in the mode faithful.
        """
        # Here: they import the search, which many commands that open a source do not need.
        from pmcl_ros.pipeline import check_mode
        from pmcl_ros.warm_up import chain as of
        check_mode(self.mode, pictures)
        faithful = self.mode == 'faithful'
        stages = of.FILTER if faithful else of.SEARCH
        if posed and self.with_volume:
            stages += of.PLANE_SWEEP
        if not pictures and (self.with_volume or faithful):
            stages += of.VOLUME
        if raw:
            stages += DECODE
        if not faithful and (self.evidence == 'edges' or not pictures):
            stages += of.EDGES
        compile_ahead(STDERR, (*stages, *also))


@dataclass(frozen=True, kw_only=True)
class GivenReading:
    """The options of a command that say how pictures are read."""

    every: int = 1
    shrink: int = 1
    scale: float | None = None
    distance: tuple[str, str, float] | None = None
    masks: Path | None = None
    image_topic: str | None = None
    pose_topic: str | None = None
    collect: Path | None = None
    sigma_mm: float | None = None
    sigma_deg: float | None = None
    common: float | None = None

    def reading(self, sources: Collection[Path], where: str) -> Reading:
        """How to read sources. Raises UsageError for options that are for none of them.

        where: subject and verb of that error. Raises SettingsError for a wrong file.
        """
        if self.scale is not None and self.distance is not None:
            raise click.UsageError('--scale and --distance say the same: give one')
        metric = Metric(self.scale, self.distance)
        if metric.is_given and not any(map(has_scale, sources)):
            raise click.UsageError(f'{where} no COLMAP model and no transforms.json: --scale and '
                                   '--distance are for these')
        if self.masks is not None and not any(map(is_colmap, sources)):
            raise click.UsageError(f'{where} no COLMAP model: --masks is for these')
        bag = self._bag_views()
        if bag is not None and not any(map(is_bag, sources)):
            raise click.UsageError(f'{where} no bag: --image-topic, --pose-topic and --collect '
                                   'are for bags')
        return Reading(self.every, self.shrink, metric, bag, self._errors(), self.masks)

    @property
    def mask_files(self) -> dict[str, Path]:
        """Those of `masks`, by their paths from the folder that holds it."""
        if self.masks is None:
            return {}
        return {each.relative_to(self.masks.parent).as_posix(): each
                for each in [self.masks, *sorted(self.masks.rglob('*'))]}

    def _bag_views(self) -> BagViews | None:
        """How images with poses of a bag are read, where that is said."""
        topics = {'image_topic': self.image_topic, 'pose_topic': self.pose_topic}
        values = {} if self.collect is None else read_yaml(self.collect)
        values |= {name: each for name, each in topics.items() if each is not None}
        return BagViews.make(values, str(self.collect or 'topics')) if values else None

    def _errors(self) -> PoseErrors | None:
        if self.sigma_mm is None and self.sigma_deg is None:
            if self.common is not None:
                raise click.UsageError('--common is a share of what --sigma-mm and --sigma-deg '
                                       'say: give these too')
            return None
        return PoseErrors(None if self.sigma_mm is None else 1e-3 * self.sigma_mm,
                          None if self.sigma_deg is None else math.radians(self.sigma_deg),
                          self.common)


@dataclass(frozen=True)
class GivenSource(GivenReading):
    """The arguments of a command that say where the pictures are, and how to read them."""

    source: Path
    calibration: Path | None = None
    white: Path | None = None
    takes_raw: bool = True

    def open(self, search: Search | None = None) -> Opened:
        """Read what must be there: calibration, white image, a bag.

        search: in what is read; the kernels of both are compiled, where they are not on disk.
        """
        reading = self._reading()
        opened = self._open(reading, search)
        if reading.errors is not None and not opened.posed:
            raise click.UsageError(f'{self.source} has no poses of its cameras: --sigma-mm and '
                                   '--sigma-deg are errors of such')
        if search is not None:
            search.compile_kernels(pictures=opened.pictures, posed=opened.posed)
        return opened

    def _reading(self) -> Reading:
        return self.reading([self.source], f'{self.source} is')

    def _open(self, reading: Reading, search: Search | None) -> Opened:
        if is_bag(self.source):
            return self._open_bag(reading, search)
        if is_light_field(self.source):
            if self.source.is_dir():
                self._check_folder(reading, search)
            self._check_no_raw()
            return Opened(partial(reading.read, self.source), has_pictures(self.source),
                          has_posed_views(self.source),
                          reading.metric is not None and reading.metric.is_given)
        suffix = self.source.suffix.lower()
        if suffix in _OF_BAGS:
            raise click.UsageError(f'{self.source} is a file of a bag: give its folder, with '
                                   'metadata.yaml in it')
        if suffix in PICTURE_SUFFIXES and self.calibration is None:
            raise click.UsageError(f'{self.source} is a picture of an ordinary camera: write '
                                   'views.yaml beside it, and give that '
                                   '(docs/howto/one_picture.md)')
        if not self.takes_raw:
            raise click.UsageError(f'{self.source} is a raw picture, and posed views are needed: '
                                   'views.yaml, transforms.json, a COLMAP model, a BOP scene or '
                                   'a bag')
        if self.calibration is None or self.white is None:
            raise click.UsageError(f'{self.source} is a raw picture: it needs --calibration and '
                                   f'--white. {OF_CAMERA}')
        self.check_of_raw()
        return _decoded(read_raw_frame(self.source), self.calibration, self.white, search)

    def _open_bag(self, reading: Reading, search: Search | None) -> Opened:
        if (self.every, self.shrink) != (1, 1):
            raise click.UsageError(f'{self.source} is a bag: --every and --shrink are for light '
                                   'fields and lists of pictures; of images with poses shrink is '
                                   'a key of --collect')
        capture = reading.read_bag(self.source)
        if isinstance(capture, RawFrame):
            return _decoded(capture, self.calibration or _configured('calibration'),
                            self.white or _configured('white'), search)
        self._check_no_raw()
        if isinstance(capture, PosedViews):  # nothing else says how many
            STDERR.print(f'{self.source}: {len(capture.views)} views, poses in the frame '
                         f'{capture.header.frame_id!r}', markup=False, soft_wrap=True)
        is_posed = isinstance(capture, PosedViews)
        return Opened(lambda: capture, is_posed, is_posed)

    def _check_folder(self, reading: Reading, search: Search | None) -> None:
        try:
            check_folder(self.source)
        except LightFieldError:
            if any(self.source.glob('*.mcap')):
                self._open_bag(reading, search)  # it is none either: what it lacks is said
            raise

    def check_of_raw(self) -> None:
        """Raise UsageError for options that are not for a raw picture."""
        if (self.every, self.shrink) != (1, 1):
            raise click.UsageError(f'{self.source} is a raw picture: --every and --shrink are for '
                                   'light fields and lists of pictures')
        if self._reading().errors is not None:
            raise click.UsageError(f'{self.source} is a raw picture: --sigma-mm and --sigma-deg '
                                   'are for posed views')

    def _check_no_raw(self) -> None:
        if self.calibration is not None or self.white is not None:
            raise click.UsageError(f'{self.source} is no raw picture: --calibration and --white '
                                   'are for these')


def view_options(command: Callable[..., None]) -> Callable[..., None]:
    """The arguments of a command that takes views; it gets them as `source`, a GivenSource."""
    @wraps(command)
    def with_source(**values: Any) -> None:
        given = {each.name: values.pop(each.name) for each in fields(GivenSource)
                 if each.name in values}
        command(source=GivenSource(**given, takes_raw='calibration' in given), **values)
    return with_options((click.argument('source', type=SOURCE), *_OF_READING), with_source)


def reading_options(command: Callable[..., None]) -> Callable[..., None]:
    """The options of how pictures are read; the command gets them as `given`, a GivenReading."""
    @wraps(command)
    def with_given(**values: Any) -> None:
        given = {each.name: values.pop(each.name) for each in fields(GivenReading)}
        command(given=GivenReading(**given), **values)
    return with_options((*_OF_READING, *_OF_POSES), with_given)


def posed_options(command: Callable[..., None]) -> Callable[..., None]:
    """Those of `view_options`, and of the errors of the cameras' poses."""
    return with_options(_OF_POSES, view_options(command))


def source_options(command: Callable[..., None]) -> Callable[..., None]:
    """Those of `posed_options`, of a command that takes raw pictures too."""
    return with_options(_OF_RAW, posed_options(command))


def open_decoders(calibration: Calibration, white: Path, views: int = VIEWS,
                  size: tuple[int, int] | None = None) -> Decoders:
    """Decoders that print each choice among a folder's white images."""
    report = (lambda why: STDERR.print(f'white image: {why}', markup=False, soft_wrap=True)
            ) if white.is_dir() else None
    return Decoders(calibration, white, report, views, size)


def _decoded(frame: RawFrame, calibration: Path, white: Path, search: Search | None) -> Opened:
    if search is None:
        compile_ahead(STDERR, DECODE)
    else:
        search.compile_kernels(raw=True)
    decoders = open_decoders(Calibration.load(calibration), white)
    decoders.decoder_for(frame.metadata)
    return Opened(partial(decoders.decode, frame), serial=frame.metadata.serial)


def _configured(name: str) -> Path:
    """The value of a parameter of subaperture_node in config/pmcl.yaml."""
    path = resolve(_CONFIG, 'config')
    try:
        value: Any = read_yaml(path)['/**/subaperture_node']['ros__parameters'][name]
    except (KeyError, TypeError):
        raise SettingsError(f'{path} names no {name} of subaperture_node; give --{name}') from None
    return resolve(str(value), name)
