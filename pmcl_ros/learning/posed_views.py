"""Learns from searches in several views: thresholds, and how sure poses are by how views agree."""

import contextlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq, minimize
from scipy.special import chdtr

from pmcl_ros.evidence.learned import LearnedViews
from pmcl_ros.evidence.posed_evidence import ViewsEvidence
from pmcl_ros.geometry.pose_error import pose_error
from pmcl_ros.learning.contour_errors import LEVEL
from pmcl_ros.learning.searches import Supports
from pmcl_ros.pmcl.multi_view.joint_evidence import JointEvidence, disagreement
from pmcl_ros.pmcl.multi_view.joint_posterior import JointPosterior
from pmcl_ros.pmcl.multi_view.localizer import MultiViewLocalizer
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.render.numba_renderer import NumbaRenderer
from pmcl_ros.pmcl.settings import PmclSettings
from pmcl_ros.runtime.errors import LocalizationError

# While these are learned: nothing is lost, and the model error is that of one view.
_NONE = LearnedViews(least_evidence=-1e9, least_support=-1e9, agreeing=1, disagreeing=0)
_FIRST = 0.3  # where the search for both shares begins
_LEAST, _MOST = 0.01, 100.0  # bounds of their common factor


@dataclass(frozen=True)
class ViewsExample:
    """A scene's views, the object in it and its true pose (4, 4), if it is there.

    settings: with the region of interest, in the frame of the poses.
    """

    evidence: ViewsEvidence
    model: ObjectModel
    pose: NDArray[np.float64]
    settings: PmclSettings
    there: bool


@dataclass(frozen=True)
class ViewsDeviation:
    """Deviation (d,) of a true pose from the one found, and what explains it.

    noise: (d, d) covariance of the posterior without a model error. error: (d, d) by that of one
    view. disagreement: of the views.
    """

    deviation: NDArray[np.float64]
    noise: NDArray[np.float64]
    error: NDArray[np.float64]
    disagreement: float

    def spread(self, agreeing: float, disagreeing: float) -> NDArray[np.float64]:
        """(d, d) covariance by noise and model error."""
        return self.noise + (agreeing + disagreeing * self.disagreement) * self.error

    def level(self, agreeing: float, disagreeing: float) -> float:
        """Of the smallest credible region that holds the truth."""
        spread = self.spread(agreeing, disagreeing)
        return float(chdtr(len(spread), self.deviation @ np.linalg.solve(spread, self.deviation)))


@dataclass(frozen=True)
class ViewsSearch:
    """One search, as `searches.Search`."""

    there: bool
    support: float
    evidence: float
    weight: float
    deviation: ViewsDeviation | None = None


def searches(examples: Iterable[ViewsExample], seed: int) -> Iterator[ViewsSearch]:
    """Search some views of each scene for its object, and for the object of the scene before."""
    before: ObjectModel | None = None
    for each in examples:
        for chosen in _subsets(len(each.evidence.views)):
            views = replace(each.evidence,
                            views=tuple(each.evidence.views[number] for number in chosen))
            yield _search(replace(each, evidence=views), seed)
            if before is not None:
                yield _search(replace(each, evidence=views, model=before, there=False), seed)
        before = each.model


def _subsets(count: int) -> list[Sequence[int]]:
    """Two views a half of the whole apart, three over all of it, all."""
    found: list[Sequence[int]] = [(count // 4, count - 1 - count // 4), range(count)]
    return found if count < 5 else [found[0], (0, count // 2, count - 1), found[1]]


def _search(example: ViewsExample, seed: int) -> ViewsSearch:
    with MultiViewLocalizer(example.model, example.settings, _NONE) as localizer:
        estimate = localizer.localize(example.evidence, np.random.default_rng(seed))
    deviation = None
    if example.there and pose_error(estimate.pose, example.pose, example.model.symmetry).right:
        deviation = _deviation(example, estimate.pose)
    return ViewsSearch(example.there, estimate.support, estimate.evidence,
                       estimate.modes[0].weight, deviation)


def _deviation(example: ViewsExample, pose: NDArray[np.float64]) -> ViewsDeviation:
    """Of a pose (4, 4) in the reference frame."""
    joint = JointEvidence.from_views(example.evidence, NumbaRenderer(), example.model,
                                     example.settings)
    first = example.evidence.views[joint.numbers[0]]
    into = np.linalg.inv(first.camera_to_reference)
    symmetry = example.model.symmetry
    with contextlib.ExitStack() as stack:
        contours = joint.open(stack)
        posterior = JointPosterior(example.model, example.settings, contours, _NONE)
        mode = posterior.refine(into @ pose)
        apart = disagreement(posterior.fits_near(mode.pose))
    truth = symmetry.nearest_equivalents((into @ example.pose)[None], mode.pose)
    local = mode.local
    return ViewsDeviation(local.basis.T @ symmetry.local(truth, mode.pose)[0],
                          np.asarray(np.linalg.inv(local.scale * local.information), float),
                          local.model_error, apart)


def learned_from(found: Sequence[ViewsSearch], least_weight: float, false_alarms: float,
                 report: Callable[[str], object]) -> LearnedViews:
    """Thresholds and shares of the model error. Raises LocalizationError for too few searches.

    The support is one that the share `false_alarms` of objects elsewhere exceeds, the evidence one
    that as many right poses do not reach.
    """
    there = np.array([each.there for each in found], bool)
    support = np.array([each.support if each.weight >= least_weight else -np.inf
                        for each in found])
    right = [each for each in found if each.deviation is not None]
    if there.all() or not right:
        raise LocalizationError(f'{len(found)} searches, {len(right)} of them with a right pose, '
                                f'{int((~there).sum())} for another object: learn from more '
                                'scenes')
    supports = Supports(support[there], support[~there],
                        np.array([each.evidence for each in right]))
    least, evidence = supports.threshold(false_alarms), supports.least_evidence(false_alarms)
    report(f'least support {least:.2f}, at {100 * false_alarms:.0f} % false alarms; '
           f'{100 * supports.missed(least):.0f} % of what is there has less')
    report(f'least evidence {evidence:.2f}: {100 * false_alarms:.0f} % of right poses have less')
    deviations = [each.deviation for each in right if each.deviation is not None
                  and each.support >= least and each.evidence >= evidence
                  and each.weight >= least_weight]
    agreeing, disagreeing = fitted_shares(deviations)
    levels = np.array([each.level(agreeing, disagreeing) for each in deviations])
    report(f'model error: {agreeing:.2f} of its variance where views agree, {disagreeing:.2f} '
           'where they disagree as much')
    for level in (0.5, LEVEL):
        report(f'truths in the {100 * level:.0f} % region: {100 * (levels <= level).mean():.0f} % '
               f'of {len(levels)}')
    return LearnedViews(least_evidence=round(evidence, 2), least_support=round(least, 2),
                        agreeing=round(agreeing, 3), disagreeing=round(disagreeing, 3))


def fitted_shares(given: Sequence[ViewsDeviation]) -> tuple[float, float]:
    """Shares of the model error of the most likely ratio, scaled to the nominal coverage.

    Raises LocalizationError where no factor gives that coverage.
    """
    def unlikely(logarithms: NDArray[np.float64]) -> float:
        total = 0.0
        for each in given:
            spread = each.spread(*np.exp(logarithms))
            total += 0.5 * (each.deviation @ np.linalg.solve(spread, each.deviation)
                            + np.linalg.slogdet(spread)[1])
        return float(total)

    agreeing, disagreeing = np.exp(minimize(unlikely, np.log([_FIRST, _FIRST]),
                                            method='Nelder-Mead').x)

    def excess(scale: float) -> float:
        levels = [each.level(scale * agreeing, scale * disagreeing) for each in given]
        return float(np.quantile(levels, LEVEL)) - LEVEL

    if excess(_LEAST) < 0 or excess(_MOST) > 0:
        raise LocalizationError(f'{len(given)} poses do not bound the model error of several '
                                'views; learn from more scenes')
    scale = brentq(excess, _LEAST, _MOST)
    return float(scale * agreeing), float(scale * disagreeing)
