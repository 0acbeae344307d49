"""Captures with known truth, localised many times: the figures behind every claim."""

import csv
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path

import numpy as np

from pmcl_ros.camera.files import is_picture, list_pictures, read_raw_frame
from pmcl_ros.dlv.build import build_volume
from pmcl_ros.dlv.pairs import StereoPairs
from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.errors import SettingsError
from pmcl_ros.evaluation.errors import pose_error
from pmcl_ros.evaluation.truth import Truth
from pmcl_ros.lightfield.decoders import Decoders
from pmcl_ros.lightfield.geometry import ViewGrid
from pmcl_ros.lightfield.light_field import LightField
from pmcl_ros.lightfield.sources.read import read_light_field
from pmcl_ros.pmcl.localizer import Localizer
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.region import Region
from pmcl_ros.pmcl.settings import Mode, PmclSettings

_MOST_LABELS = 1000  # that the settings allow; the volume warns where more are needed


@dataclass(frozen=True)
class Trial:
    """One localisation. Errors in mm and degrees (of the symmetry axis where there is one).

    ray_mm: signed along the line of sight, positive: too far. seconds: from the volume.
    """

    capture: str
    mode: str
    seed: int
    translation_mm: float
    ray_mm: float
    axis_deg: float
    flipped: bool
    lost: bool
    empty: bool
    seconds: float


def find_captures(folder: Path | str) -> list[Path]:
    """The subfolders with a picture, a model.obj and a truth.json, sorted.

    Raises SettingsError when there is none.
    """
    found = sorted(path.parent for path in Path(folder).glob('*/truth.json')
                   if (path.parent / 'model.obj').exists())
    if not found:
        raise SettingsError(f'{folder} has no subfolder with a picture, model.obj and truth.json')
    return found


def run_trials(capture: Path, decoders: Decoders | None, mode: Mode, seeds: Iterable[int]
               ) -> Iterator[Trial]:
    """Localise one capture once for each seed.

    decoders: of the camera; None where the capture is a light field, not a raw picture.
    """
    truth = Truth.load(capture / 'truth.json')
    model = ObjectModel.load(capture / 'model.obj')
    near, far = Region(truth.roi_center, truth.roi_size).grown(model.radius)
    light_field = _light_field(capture, decoders)
    volume = build_volume(light_field, volume_settings(mode, near, far, light_field.grid))
    settings = PmclSettings(mode=mode, roi_center=truth.roi_center, roi_size=truth.roi_size)
    with Localizer(model, settings) as localizer:
        for seed in seeds:
            started = time.perf_counter()
            estimate = localizer.localize(volume, np.random.default_rng(seed))
            seconds = time.perf_counter() - started
            error = pose_error(estimate.pose, truth.pose, model.axis)
            yield Trial(capture.name, mode, seed, 1e3 * error.translation, 1e3 * error.ray,
                        float(np.rad2deg(error.rotation)), error.flipped, estimate.lost,
                        truth.empty, seconds)


def _light_field(capture: Path, decoders: Decoders | None) -> LightField:
    """Of the raw picture in a capture's folder, where there is one, else of the views there."""
    if not any(is_picture(path) for path in capture.iterdir()):
        return read_light_field(capture)
    picture = list_pictures(capture)[0]
    if decoders is None:
        raise SettingsError(f'{picture} is a raw picture: its calibration is needed')
    return decoders.decode(read_raw_frame(picture))


def volume_settings(mode: Mode, near: float, far: float, grid: ViewGrid) -> DlvSettings:
    """The volume that belongs to a mode: the paper shifts by phase, truncates, weighs no views.

    There are as many labels as by default, or more where the views are farther apart.
    """
    default = DlvSettings()
    needed = min(StereoPairs.of(grid, default.views).labels_needed(near, far), _MOST_LABELS)
    values: dict[str, object] = {'near': near, 'far': far, 'labels': max(default.labels, needed),
                                 'edge_labels': max(default.edge_labels, needed)}
    if mode == 'faithful':
        values |= {'interpolation': 'phase', 'truncate': True, 'view_weights': 'equal'}
    return DlvSettings.make(values, 'region of interest')


def write_csv(path: Path, trials: Sequence[Trial]) -> None:
    """One row a trial."""
    with path.open('w', newline='') as stream:
        writer = csv.DictWriter(stream, [field.name for field in fields(Trial)])
        writer.writeheader()
        writer.writerows(asdict(trial) for trial in trials)


def markdown(trials: Sequence[Trial]) -> str:
    """A table with a row for each capture and mode: medians, worst, and how often it was lost."""
    heads = ['capture', 'mode', 'trials', 'median error', 'worst', 'along the ray',
             'median axis error', 'flipped', 'lost', 'median time']
    lines = [f'| {" | ".join(heads)} |', '|' + '---|' * len(heads)]
    for capture, mode in dict.fromkeys((each.capture, each.mode) for each in trials):
        rows = [each for each in trials if (each.capture, each.mode) == (capture, mode)]
        lost = f'{sum(each.lost for each in rows)} of {len(rows)}'
        seconds = float(np.median([each.seconds for each in rows]))
        if rows[0].empty:
            errors = ['(nothing there)', '', '', '', '']
        else:
            mm = [each.translation_mm for each in rows]
            errors = [f'{np.median(mm):.1f} mm', f'{max(mm):.1f} mm',
                      f'{np.median([each.ray_mm for each in rows]):+.1f} mm',
                      f'{np.median([each.axis_deg for each in rows]):.1f}°',
                      f'{sum(each.flipped for each in rows)}']
        cells = [capture, mode, str(len(rows)), *errors, lost, f'{seconds:.1f} s']
        lines.append('| ' + ' | '.join(cells) + ' |')
    return '\n'.join(lines)
