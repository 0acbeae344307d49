"""The findings as one HTML page that loads nothing from outside."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from pmcl_ros import __version__
from pmcl_ros.drawing.charts import Chart, Line, draw
from pmcl_ros.drawing.pictures import contact_sheet, displayed, outlines
from pmcl_ros.evaluation.feasibility import findings
from pmcl_ros.evaluation.feasibility.findings import Aim
from pmcl_ros.evaluation.feasibility.scene_trials import read_scene
from pmcl_ros.evaluation.feasibility.view_sets import ViewSet
from pmcl_ros.evaluation.report.html import image, rendered
from pmcl_ros.evaluation.trials import Trial
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.posed_view import PosedViews
from pmcl_ros.pmcl.object_model import ObjectModel

_WORST, _SHOWN = 4, 6  # pictures of bad cases, and of scenes
_WIDTH = 720  # px of a bad case
_FARTHEST = 20.0  # mm: end of the curves


@dataclass(frozen=True)
class Feasibility:
    """A study of one object and one camera.

    about: names and values that say what was simulated. trials: of each set, by its name.
    folder: of the scenes.
    """

    model: ObjectModel
    about: Mapping[str, str]
    sets: tuple[ViewSet, ...]
    trials: dict[str, list[Trial]]
    aim: Aim
    folder: Path

    @property
    def recommendation(self) -> str:
        """In plain words (`findings.recommendation`)."""
        return findings.recommendation(self.sets, self.trials, self.aim)

    def table(self) -> tuple[list[str], list[list[str]]]:
        """Head and rows, one for each set."""
        return ['views', *findings.HEAD], [
            [each.name, *findings.row(self.trials[each.name], self.aim)] for each in self.sets]

    def table_by(self, name: str, groups: Sequence[findings.Group]
                 ) -> tuple[list[str], list[list[str]]]:
        """Head and rows, one for each set and group. name: of what makes groups."""
        return ['views', name, *findings.HEAD], [
            [each.name, group, *findings.row(
                list(filter(belongs, self.trials[each.name])), self.aim)]
            for each in self.sets for group, belongs in groups]

    @property
    def best(self) -> ViewSet:
        """The set of which the worst cases are shown: that with the most good ones."""
        return max(self.sets, key=lambda each: sum(map(self.aim.reached,
                                                       self.trials[each.name])))


def page(of: Feasibility) -> str:
    """The text of the HTML file."""
    every = [each for trials in of.trials.values() for each in trials]
    first = of.trials[of.sets[0].name]
    return rendered(
        'feasibility.html', 'pmcl_ros.evaluation.feasibility',
        of=of, about=of.about,
        groups={'distance': findings.distances(first),
                'surroundings': findings.surroundings(every)},
        causes=[(each.name, findings.causes(of.trials[each.name], of.aim)) for each in of.sets],
        curves=image(_curves(of), 'share of scenes found, over the error allowed', 'chart'),
        enough=len(first) >= findings.LEAST,
        scenes=image(_scenes(of), 'some of the scenes'), worst=_worst(of), least=findings.LEAST,
        version=__version__)


def _curves(of: Feasibility) -> NDArray[np.uint8]:
    bounds = np.linspace(0, _FARTHEST, 201)
    lines = [Line(each.name, bounds, findings.success(of.trials[each.name], bounds, of.aim),
                  number) for number, each in enumerate(of.sets)]
    return draw([[Chart(f'claimed within the error and {of.aim.degrees:g} degrees', 'error [mm]',
                        'scenes [%]', lines, (0, _FARTHEST))]])


def _scenes(of: Feasibility) -> NDArray[np.uint8]:
    chosen = of.trials[of.sets[0].name][:_SHOWN]
    return contact_sheet([_picture(of.folder, each)[0] for each in chosen], 1200)


def _worst(of: Feasibility) -> list[tuple[Markup, str]]:
    """Pictures with the outlines of the true pose and of the one found, and what they show."""
    shown = []
    for each in findings.worst(of.trials[of.best.name], _WORST):
        seen, pinhole = _picture(of.folder, each)
        poses = [np.vstack([np.reshape(rows, (3, 4)), [0, 0, 0, 1]])
                 for rows in (each.extra['truth'], each.pose)]
        drawn = outlines(seen, pinhole, [(of.model, poses[0], 'true'),
                                         (of.model, poses[1], 'found')])
        word = 'lost' if each.lost else 'found' if each.near else 'wrong'
        drawn = np.asarray(cv2.resize(drawn, (_WIDTH, _WIDTH * len(drawn) // drawn.shape[1]),
                                      interpolation=cv2.INTER_AREA), np.uint8)
        shown.append((image(drawn, f'scene {each.seed}'),
                      f'Seed {each.seed}, {each.capture}: {word}; {each.translation_mm:.1f} mm, '
                      f'{each.axis_deg:.1f} degrees off.'))
    return shown


def _picture(folder: Path, trial: Trial) -> tuple[NDArray[np.uint8], Pinhole]:
    """The picture in whose frame the trial's poses are."""
    source = read_scene(folder / f'{trial.seed:06d}')
    if isinstance(source, PosedViews):
        source = source.views[trial.extra['picture']]
    return displayed(source), source.pinhole
