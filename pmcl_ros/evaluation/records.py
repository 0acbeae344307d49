"""Writes trials for other programs: a CSV of all, BOP's CSV, the settings and versions."""

import csv
import importlib.metadata
import os
import platform
import sys
from collections import defaultdict
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import numpy as np

from pmcl_ros import __version__
from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.evaluation.captures import Capture
from pmcl_ros.evaluation.trial_plan import TrialPlan
from pmcl_ros.evaluation.trials import Trial
from pmcl_ros.evaluation.variants import Variant
from pmcl_ros.pipeline import volume_settings
from pmcl_ros.runtime.binary_file import sha256
from pmcl_ros.runtime.closing import Closing
from pmcl_ros.runtime.outputs import replacing, writing

COLUMNS = tuple(each.name for each in fields(Trial) if each.name != 'extra')  # of results.csv
_LIBRARIES = ('numpy', 'scipy', 'numba', 'opencv-python-headless', 'moderngl', 'trimesh')
_BOP = ('scene_id', 'im_id', 'obj_id', 'score', 'R', 't', 'time')


class TrialsFile(Closing):
    """A CSV with a row for each trial, written as trials come."""

    def __init__(self, path: Path) -> None:
        self._path = path
        with writing(path):
            self._stream = path.open('w', newline='')
            self._writer = csv.DictWriter(self._stream, COLUMNS, extrasaction='ignore')
            self._writer.writeheader()

    def close(self) -> None:
        """Close the file."""
        with writing(self._path):
            self._stream.close()

    def add(self, trial: Trial) -> None:
        """Write one row, at once to the disk."""
        with writing(self._path):
            self._writer.writerow(asdict(trial) | {'pose': _numbers(trial.pose)})
            self._stream.flush()


def write_bop(path: Path, trials: Sequence[Trial], plan: TrialPlan) -> None:
    """The poses found, as BOP's toolkit reads them: R row by row, t in mm, time in seconds.

    Of a BOP data set the numbers are its own, of several pictures those of the first. Else a scene
    is a capture and an image one of its trials (its seed), both counted from 0, an object a mesh,
    counted from 1; `settings` lists them. A data set's picture has the pose of the first seed: its
    toolkit would take the best of all, and its time is that of all its objects, which the toolkit
    asks for. Lost poses and searches for an object of another capture are left out.
    """
    captures = {each.name: each for each in plan.captures}
    numbers = _numbers_of(plan)
    def image_of(each: Trial) -> tuple[int, int]:
        of = captures[each.capture].bop_numbers
        return numbers[each.capture][0], each.seed if of is None else of[1]

    searched = [each for each in trials if not each.wrong and (
        captures[each.capture].bop_numbers is None or each.seed == plan.seeds[0])]
    times: defaultdict[tuple[int, int], float] = defaultdict(float)
    for each in searched:
        times[image_of(each)] += each.seconds + each.dlv_seconds + each.decode_seconds
    with replacing(path) as part, part.open('w', newline='') as stream:
        writer = csv.DictWriter(stream, _BOP)
        writer.writeheader()
        for each in searched:
            if each.lost:
                continue
            rows = np.reshape(each.pose, (3, 4))
            image = image_of(each)
            writer.writerow({
                'scene_id': image[0], 'im_id': image[1],
                'obj_id': numbers[each.capture][1], 'score': each.score,
                'R': _numbers(rows[:, :3].ravel().tolist()),
                't': _numbers((1e3 * rows[:, 3]).tolist()),
                'time': times[image]})


def _numbers_of(plan: TrialPlan) -> dict[str, tuple[int, int]]:
    """By the name of each capture the numbers of its scene and object."""
    digests = {digest: number for number, digest in enumerate(
        dict.fromkeys(each.object for each in plan.captures), 1)}
    return {each.name: (number, digests[each.object]) if each.bop_numbers is None
            else (each.bop_numbers[0], each.bop_numbers[2])
            for number, each in enumerate(plan.captures)}


def _numbers(values: Sequence[float]) -> str:
    return ' '.join(repr(float(each)) for each in values)


def settings(plan: TrialPlan, files: Mapping[str, Path], processes: int, seconds: float
             ) -> dict[str, Any]:
    """All that is needed to make a table again, on any machine.

    files: by name, those that were read beside the captures, as calibration and white image.
    """
    numbers = _numbers_of(plan)
    return {
        'pmcl_ros': __version__,
        'python': platform.python_version(),
        'libraries': libraries(),
        'machine': {'system': platform.platform(), 'processor': _processor(),
                    'cores': os.cpu_count()},
        'processes': processes,
        'seconds': round(seconds, 1),
        'command': sys.argv[1:],
        'files': {name: sha256(each) for name, each in files.items() if each.is_file()},
        'seeds': list(plan.seeds),
        'rows': {each.name: {
            'base': each.base, 'search': each.search(plan.captures[0]).model_dump(
                exclude={'roi_center', 'roi_size', 'seed', 'object'}),
            'volume': _volume(each)} for each in plan.variants},
        'captures': [{
            'scene_id': numbers[each.name][0], 'name': each.name,
            'obj_id': numbers[each.name][1],
            'empty': each.truth.empty, 'film': each.truth.film,
            'sha256': _digests(each)} for each in plan.captures],
        'other_objects': [each.name for each in plan.others],
    }


def _volume(variant: Variant) -> dict[str, Any]:
    """A row's settings of the volume but those that depend on the capture, if not chosen."""
    default, chosen = DlvSettings(), dict(variant.dlv)
    made = volume_settings(variant.mode, default.near, default.far, None, chosen, variant.name)
    return made.model_dump(exclude={'near', 'far', *({'labels', 'edge_labels'} - chosen.keys())})


def libraries() -> dict[str, str]:
    """The versions of the libraries that compute; 'unknown' for packages of the system."""
    found = dict.fromkeys(_LIBRARIES, 'unknown')
    for each in _LIBRARIES:
        with suppress(importlib.metadata.PackageNotFoundError):
            found[each] = importlib.metadata.version(each)
    return found


def _digests(capture: Capture) -> dict[str, str]:
    """Of the files of a capture, by their paths from its source."""
    return {Path(os.path.relpath(each, capture.source)).as_posix(): sha256(each)
            for each in capture.files()}


def _processor() -> str:
    """The processor's name; platform.processor is empty on most Linuxes."""
    try:
        lines = Path('/proc/cpuinfo').read_text().splitlines()
    except OSError:
        return platform.processor()
    names = [line.partition(':')[2].strip() for line in lines if line.startswith('model name')]
    return names[0] if names else platform.processor()
