"""Calibrates the network's logits on pictures apart from training, and measures what it finds.

All pixels are counted in histograms of the logit, from which everything is computed.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.special import expit

from pmcl_ros.drawing.charts import Chart, Line
from pmcl_ros.evidence.contour_map import DIRECTIONS, harmonics
from pmcl_ros.evidence.learned import Calibration
from pmcl_ros.learning.contour_net.directions import direction_targets
from pmcl_ros.learning.contour_net.pictures import BINS
from pmcl_ros.runtime.errors import PictureError, told_as
from pmcl_ros.simulation.labelled_pictures import read_labelled

_EDGES = np.linspace(-30, 30, 1201)  # of logits; those beyond are in the outer bins
_CENTRES = (_EDGES[:-1] + _EDGES[1:]) / 2
_LEAST = 20  # pixels for which it is true, and is not, of a point of the reliability curve
_PARTS = np.linspace(-12, 6, 37)  # predicted log odds, of a reliability curve

# A network: a picture (height, width, 3) -> its logits (height, width, 6).
Logits = Callable[[NDArray[np.generic]], NDArray[np.float32]]


@dataclass(frozen=True)
class Histogram:
    """Pixels, and those of them for which it is true, by the logit: (bins,) each."""

    pixels: NDArray[np.float64]
    true: NDArray[np.float64]

    @classmethod
    def count(cls, logit: NDArray[np.floating], true: NDArray[np.floating]) -> 'Histogram':
        """Count values of one shape; true: 0 to 1."""
        scaled = (np.clip(logit.ravel(), _EDGES[0], _EDGES[-1]) - _EDGES[0]) * (
            (len(_EDGES) - 1) / (_EDGES[-1] - _EDGES[0]))
        bins = np.minimum(scaled.astype(np.int32), len(_CENTRES) - 1)
        return cls(np.bincount(bins, minlength=len(_CENTRES)).astype(float),
                   np.bincount(bins, true.ravel(), len(_CENTRES)).astype(float))

    def __add__(self, other: 'Histogram') -> 'Histogram':
        return Histogram(self.pixels + other.pixels, self.true + other.true)

    def calibration(self) -> Calibration:
        """Scale and bias of the highest likelihood, and the base rate."""
        false = self.pixels - self.true

        def loss(values: NDArray[np.floating]) -> tuple[float, NDArray[np.floating]]:
            odds = values[0] * _CENTRES + values[1]
            slope = (self.pixels * expit(odds) - self.true) / self.pixels.sum()
            value = self.true @ np.logaddexp(0, -odds) + false @ np.logaddexp(0, odds)
            return value / self.pixels.sum(), np.array([slope @ _CENTRES, slope.sum()])

        best = minimize(loss, [1.0, 0.0], jac=True, method='BFGS', options={'gtol': 1e-9})
        return Calibration(scale=round(float(best.x[0]), 4), bias=round(float(best.x[1]), 4),
                           rate=float(f'{self.true.sum() / self.pixels.sum():.4g}'))

    def reliability(self, calibration: Calibration
                    ) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
        """(log odds predicted, log odds that are so) of groups of pixels."""
        predicted = calibration.scale * _CENTRES + calibration.bias
        part = np.digitize(predicted, _PARTS)
        pixels, true, mean = (np.bincount(part, each, len(_PARTS) + 1) for each in (
            self.pixels, self.true, self.pixels * predicted))
        kept = np.minimum(true, pixels - true) >= _LEAST
        return mean[kept] / pixels[kept], np.log(true[kept] / (pixels[kept] - true[kept]))

    def nats(self, calibration: Calibration) -> float:
        """What the logit tells of a pixel beside the base rate: mean log likelihood gain [nat]."""
        odds = calibration.scale * _CENTRES + calibration.bias
        base = np.log(calibration.rate / (1 - calibration.rate))
        predicted = self.true @ np.logaddexp(0, -odds) + (
            self.pixels - self.true) @ np.logaddexp(0, odds)
        blind = self.true.sum() * np.logaddexp(0, -base) + (
            self.pixels - self.true).sum() * np.logaddexp(0, base)
        return float((blind - predicted) / self.pixels.sum())

    def precision_recall(self) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
        """(precision, recall) of all thresholds, from the highest on."""
        pixels, true = self.pixels[::-1].cumsum(), self.true[::-1].cumsum()
        kept = pixels > 0
        return true[kept] / pixels[kept], true[kept] / true[-1]

    def average_precision(self) -> float:
        """Area below precision over recall."""
        precision, recall = self.precision_recall()
        return float(precision @ np.diff(recall, prepend=0))


@dataclass(frozen=True)
class Measured:
    """Histograms of many pictures.

    contour: of a direction at a pixel, by its logit; any: of a contour at a pixel, by the highest
    logit of a direction; near: the same within 1.5 px of a contour; inside: of the inside.
    """

    contour: Histogram
    any: Histogram
    near: Histogram
    inside: Histogram

    @classmethod
    def measure(cls, logits: Logits, files: Iterable[Path]) -> 'Measured':
        """Run a network on whole labelled pictures, one or more.

        Raises PictureError for one that it cannot read, PmclError for a file that is none.
        """
        steps = BINS // DIRECTIONS * np.arange(DIRECTIONS)
        basis, shares = harmonics(2 * np.pi * steps / BINS).T, direction_targets(steps)
        sums: Measured | None = None
        for each in files:
            labelled = read_labelled(each)
            with told_as(PictureError, name=each):
                out = logits(labelled.picture)
            predicted = out[..., :5] @ basis
            there = labelled.direction >= 0
            close = cv2.dilate(there.astype(np.uint8), np.ones((3, 3), np.uint8))
            one = cls(Histogram.count(predicted, shares[labelled.direction.astype(int) + 1]),
                      Histogram.count(predicted.max(-1), there.astype(float)),
                      Histogram.count(predicted.max(-1), close.astype(float)),
                      Histogram.count(out[..., 5], labelled.inside.astype(float)))
            sums = one if sums is None else Measured(
                sums.contour + one.contour, sums.any + one.any, sums.near + one.near,
                sums.inside + one.inside)
        if sums is None or not (sums.any.true.any() and sums.inside.true.any()):
            raise PictureError('no picture shows a contour: make more, as pmcl scenes pictures '
                               'does')
        return sums

    def results(self, contour: Calibration, inside: Calibration) -> dict[str, float]:
        """Average precisions, and what the calibrated logits tell of a pixel [nat]."""
        values = {
            'average_precision_of_contour_pixels': self.any.average_precision(),
            'average_precision_within_1.5_px': self.near.average_precision(),
            'average_precision_of_contours_of_a_direction': self.contour.average_precision(),
            'average_precision_of_inside': self.inside.average_precision(),
            'nats_of_contours_a_pixel': self.contour.nats(contour),
            'nats_of_inside_a_pixel': self.inside.nats(inside)}
        return {name: float(f'{value:.4g}') for name, value in values.items()}


def charts(measured: Measured, contour: Calibration, inside: Calibration) -> list[list[Chart]]:
    """Reliability of contour and inside on other pictures; precision over recall."""
    drawn = []
    for name, histogram, by in (('contour of a direction', measured.contour, contour),
                                ('inside', measured.inside, inside)):
        predicted, so = histogram.reliability(by)
        both = np.concatenate([predicted, so])
        ends = float(both.min()) - 0.5, float(both.max()) + 0.5
        drawn.append(Chart(f'Reliability: {name}', 'predicted log odds [nat]',
                           'log odds in fact [nat]',
                           [Line('measured', predicted, so), Line('ideal', ends, ends, -1, True)],
                           ends, ends))
    lines = []
    for number, (name, histogram) in enumerate((
            ('contour pixel', measured.any), ('within 1.5 px of one', measured.near),
            ('contour of a direction', measured.contour), ('inside', measured.inside))):
        precision, recall = histogram.precision_recall()
        lines.append(Line(f'{name}: {histogram.average_precision():.2f}', 100 * recall,
                          100 * precision, number))
    recall_chart = Chart('Average precision', 'recall [%]', 'precision [%]', lines, (0, 100))
    return [[*drawn, recall_chart]]
