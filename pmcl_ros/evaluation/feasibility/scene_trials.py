"""Localises the object in each set of views of a simulated scene."""

import json
import time
from collections.abc import Sequence
from dataclasses import asdict, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from pmcl_ros.camera.files import is_picture, list_pictures, read_raw_frame
from pmcl_ros.evaluation.feasibility.view_sets import ViewSet
from pmcl_ros.evaluation.named_log import log_named
from pmcl_ros.evaluation.trials import Trial, evidence_beside_truth
from pmcl_ros.geometry.truth import Truth
from pmcl_ros.lightfield.calibration.lytro.calibration import Calibration
from pmcl_ros.lightfield.decoders import Decoders
from pmcl_ros.lightfield.posed_view import PosedView, PosedViews
from pmcl_ros.lightfield.readers.read import Source, read_source
from pmcl_ros.pipeline import Pipeline
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.settings import PmclSettings
from pmcl_ros.runtime.errors import FileError
from pmcl_ros.runtime.outputs import Results, write_file
from pmcl_ros.runtime.text_file import read_json

NAME = 'trials.json'


def scene_trials(folder: Path, model: ObjectModel, sets: Sequence[ViewSet], force: bool = False
                 ) -> list[Trial]:
    """The trials of a scene, one for each set, as last time where folder/trials.json has them.

    folder: of a capture with truth. The search has the seed of the scene. Extra of a trial:
    `distance`, of the object from the camera of the first set [m]; `across_mm`, the error across
    the line of sight; `gap`, evidence of the pose found less that of the true one [nat]; `truth`,
    (12,) the true pose in the frame of `pose`; `picture`, the number of the picture whose frame
    that is. Messages of the log begin with scene and set. Raises OutputError where trials.json is
    not of an earlier run, unless `force`.
    """
    kept = _whole(folder)
    if left := missing(folder, sets):
        source, truth = read_scene(folder), Truth.load(folder / 'truth.json')
        for each in left:
            with log_named(f'{folder.name}, {each.name}'):
                kept[each.name] = _trial(source, truth, model, each, int(folder.name))
            with Results(folder, 'feasibility', force) as out:
                write_file(out.path(NAME), json.dumps(
                    {name: asdict(trial) for name, trial in kept.items()}, indent=1) + '\n')
    return _from_one_camera([kept[each.name] for each in sets])


def read_scene(folder: Path) -> Source:
    """The light field or the views of a simulated scene.

    A raw picture is decoded by calibration.yaml and white/ beside the folder. Raises as
    `read_source`, and PmclError where a raw picture has no such files.
    """
    if not any(is_picture(each) for each in folder.iterdir()):
        return read_source(folder)
    return _decoders(folder.parent).decode(read_raw_frame(list_pictures(folder)[0]))


@lru_cache(1)
def _decoders(folder: Path) -> Decoders:
    return Decoders(Calibration.load(folder / 'calibration.yaml'), folder / 'white')


def missing(folder: Path, sets: Sequence[ViewSet]) -> list[ViewSet]:
    """The sets of which folder/trials.json has no trial."""
    kept = _whole(folder)
    return [each for each in sets if each.name not in kept]


def _whole(folder: Path) -> dict[str, Trial]:
    try:
        return _read(folder / NAME)
    except FileError:
        return {}


def kept_trials(folder: Path) -> list[Trial]:
    """The trials of a scene that folder/trials.json has; none where there is no such file.

    Raises FileError for a file that has something else.
    """
    path = folder / NAME
    return _from_one_camera(list(_read(path).values())) if path.exists() else []


def _from_one_camera(trials: Sequence[Trial]) -> list[Trial]:
    """With the distance from the camera of the first."""
    return [replace(each, extra={**each.extra, 'distance': trials[0].extra['distance']})
            for each in trials]


def _read(path: Path) -> dict[str, Trial]:
    kept = read_json(path)
    try:
        trials = {name: Trial(**{**each, 'pose': tuple(each['pose'])})
                  for name, each in kept.items()}
        for each in trials.values():
            float(each.extra['distance'])
    except (KeyError, TypeError, ValueError) as error:
        raise FileError(f'{path} has no trials of this version ({error!r}); remove it, and let '
                        'pmcl feasibility search again') from error
    return trials


def _trial(source: Source, truth: Truth, model: ObjectModel, chosen: ViewSet, seed: int
           ) -> Trial:
    target, center = truth.pose, np.asarray(truth.roi_center, float)
    into = np.eye(4)
    if isinstance(source, PosedViews):
        views = [source.views[number] for number in chosen.pictures]
        first, camera = chosen.pictures[0], views[0].camera_to_reference
        if chosen.is_one and first < len(truth.cameras):  # it needs no arm, which tells another
            camera = truth.cameras[first]
        into = np.asarray(np.linalg.inv(camera), float)
        if chosen.is_one:
            center = into[:3, :3] @ center + into[:3, 3]
            one = views[0]  # in the frame of its own camera
            source = PosedView(one.header, one.picture, one.pinhole, np.eye(4))
        else:
            source = PosedViews(tuple(views))
    settings = PmclSettings(roi_center=tuple(center.tolist()), roi_size=truth.roi_size)
    posed = isinstance(source, PosedViews)
    started = time.perf_counter()
    with Pipeline.for_object(model, settings, posed=posed) as pipeline:
        run = pipeline.run(lambda: source, np.random.default_rng(seed))
        seconds = time.perf_counter() - started
        both = evidence_beside_truth(pipeline.localizer, run.evidence, run.estimate,
                                     np.asarray(target if posed else into @ target))
        assert both is not None
    estimate = run.estimate.in_frame(into) if posed else run.estimate
    seen = np.asarray(into @ target)
    trial = Trial.judge(estimate, seen, model, capture=truth.name, mode=chosen.name, seed=seed,
                        seconds=seconds)
    extra = {
        'distance': float(np.linalg.norm(seen[:3, 3])), 'gap': float(both[0] - both[1]),
        'across_mm': float(np.sqrt(max(trial.translation_mm ** 2 - trial.ray_mm ** 2, 0))),
        'truth': seen[:3].ravel().tolist(), 'picture': chosen.pictures[0]}
    return replace(trial, extra=extra)
