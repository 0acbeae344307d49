"""Trials of a simulated robot as one HTML page that loads nothing from outside."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import cv2
import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from pmcl_ros import __version__
from pmcl_ros.drawing.pictures import outlines
from pmcl_ros.evaluation.manipulation.findings import HEAD, causes, rows
from pmcl_ros.evaluation.report.html import image, rendered
from pmcl_ros.geometry.interface import Interface
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.geometry.se3 import inverse
from pmcl_ros.lightfield.readers.pictures import read_picture
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.render.sunken import as_it_appears
from pmcl_ros.simulated_robot.trial import ManipulationTrial

_HEIGHT = 180  # px of a picture


def page(title: str, about: Mapping[str, str], seen: Sequence[ManipulationTrial],
         given: Sequence[ManipulationTrial], folders: Sequence[Path], model: ObjectModel,
         pinhole: Pinhole, liquids: Sequence[Interface]) -> str:
    """The text of the HTML file.

    seen: trials by what the robot saw; folders of each, and liquids, in the robot's frame. given:
    of the same seeds, where it was given the true pose.
    """
    shown = [{'seed': each.seed, 'words': _words(each), 'caption': _caption(each),
              'picture': _pictures(each, folder, model, pinhole, liquid),
              'film': _film(folder)}
             for each, folder, liquid in zip(seen, folders, liquids, strict=True)]
    return rendered(
        'manipulation.html', 'pmcl_ros.evaluation.manipulation',
        title=title, about=about, head=HEAD, rows=rows(seen) + rows(given), causes=causes(seen),
        trials=shown, tank=any(each.place == 'tank' for each in seen), version=__version__)


def _words(trial: ManipulationTrial) -> str:
    start = 'floating' if trial.place == 'tank' else 'standing' if trial.stands else 'lying'
    return f'{start}, {trial.cause or "done"}'


def _caption(trial: ManipulationTrial) -> str:
    poses = [f'{mm:.1f} mm, {degrees:.1f} degrees' for mm, degrees in trial.poses]
    return (f'What the camera saw; the outline is of the pose at which it grasped. Errors of the '
            f'poses from two views on: {"; ".join(poses) or "none was found"}. {trial.said}')


def _pictures(trial: ManipulationTrial, folder: Path, model: ObjectModel, pinhole: Pinhole,
              liquid: Interface) -> Markup:
    """All pictures of a trial in a row."""
    pose = np.reshape(trial.grips[-1].pose, (4, 4)) if (
        trial.grips and trial.grips[-1].pose is not None) else None
    row = []
    for each in trial.pictures:
        if not (folder / each.file).is_file():  # a raw picture that was not decoded
            continue
        picture = read_picture(folder / each.file)
        if pose is not None:
            camera = np.reshape(each.camera, (4, 4))
            before = inverse(camera) @ pose
            drawn = as_it_appears(model, before, liquid.seen_from(camera))
            picture = outlines(picture, pinhole, [(drawn, before, '')])
        row.append(_reduced(picture))
    if not row:
        return Markup('')
    return image(np.concatenate(row, axis=1), f'trial {trial.seed}')


def _film(folder: Path) -> Markup:
    """The trial from outside, where it was drawn."""
    file = folder / 'film.png'
    return image(read_picture(file), 'the trial from outside') if file.is_file() else Markup('')


def _reduced(picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    size = _HEIGHT * picture.shape[1] // picture.shape[0], _HEIGHT
    return np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), np.uint8)
