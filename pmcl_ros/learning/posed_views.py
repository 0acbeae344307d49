"""Learns from searches in several views: thresholds, and how sure poses are by how views agree."""

import contextlib
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq, minimize

from pmcl_ros.evidence.learned import LearnedViews
from pmcl_ros.evidence.posed_evidence import ViewsEvidence
from pmcl_ros.geometry.pose_error import pose_error
from pmcl_ros.geometry.student_t import COMMON, credible_level
from pmcl_ros.learning.contour_errors import fitted_degrees_of_freedom
from pmcl_ros.learning.searches import Supports
from pmcl_ros.learning.support_slopes import support_slopes
from pmcl_ros.pmcl.multi_view.joint_contours import JointContours
from pmcl_ros.pmcl.multi_view.joint_evidence import JointEvidence
from pmcl_ros.pmcl.multi_view.joint_posterior import JointPosterior
from pmcl_ros.pmcl.multi_view.localizer import MultiViewLocalizer
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.render.numba_renderer import NumbaRenderer
from pmcl_ros.pmcl.settings import PmclSettings
from pmcl_ros.runtime.errors import LocalizationError

# While these are learned: nothing is lost, and the model error is that of one view. A displacement
# is about what contour maps show.
_NONE = LearnedViews(least_evidence=-1e9, least_support=-1e9, support_slope=0, beyond_slope=0,
                     error_share=1, error_views=1000, disagreement=1, displacement=0.35)
# Share, views and disagreement are within a factor of e of these, as far as is known before (one
# standard deviation): few scenes hardly tell the first two apart.
_FIRST = 0.3, 3.0, 0.3
_LEAST, _MOST = 0.01, 100.0  # bounds of the factor of the model error
_DIGITS = 2  # of the thresholds, their slopes and the displacement


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
    view. views: independent ones, disagreement: of these (`LearnedViews.share`). displacement: of
    the contours from those of the true pose [px].
    """

    deviation: NDArray[np.float64]
    noise: NDArray[np.float64]
    error: NDArray[np.float64]
    views: float
    disagreement: float
    displacement: float

    def spread(self, numbers: LearnedViews) -> NDArray[np.float64]:
        """(d, d) covariance by noise and model error."""
        return self.noise + numbers.share(self.views, self.disagreement) * self.error

    def square(self, numbers: LearnedViews) -> float:
        """The squared Mahalanobis distance of the truth."""
        return float(self.deviation @ np.linalg.solve(self.spread(numbers), self.deviation))


@dataclass(frozen=True)
class ViewsSearch:
    """One search, as `searches.Search`. disagreement, beyond, inside: as of `PoseEstimate`."""

    there: bool
    support: float
    evidence: float
    weight: float
    disagreement: float
    beyond: float
    deviation: ViewsDeviation | None = None
    inside: float = 0.0


def searches(example: ViewsExample, others: Sequence[ObjectModel], seed: int
             ) -> Iterator[ViewsSearch]:
    """Search some views of a scene for its own object, and for others that are not there."""
    for chosen in _subsets(len(example.evidence.views)):
        views = replace(example.evidence,
                        views=tuple(example.evidence.views[number] for number in chosen))
        yield _search(replace(example, evidence=views), seed)
        for other in others:
            yield _search(replace(example, evidence=views, model=other, there=False), seed)


def _subsets(count: int) -> list[Sequence[int]]:
    """Two views a half of the whole apart, and all."""
    if count < 5:
        return [range(count)]
    return [(count // 4, count - 1 - count // 4), range(count)]


def _search(example: ViewsExample, seed: int) -> ViewsSearch:
    with MultiViewLocalizer(example.model, example.settings, _NONE) as localizer:
        estimate = localizer.localize(example.evidence, np.random.default_rng(seed))
    deviation = None
    if example.there and pose_error(estimate.pose, example.pose, example.model.symmetry).right:
        deviation = _deviation(example, estimate.pose)
    return ViewsSearch(example.there, estimate.support, estimate.evidence,
                       estimate.modes[0].weight, estimate.disagreement, estimate.beyond, deviation,
                       estimate.inside)


def _deviation(example: ViewsExample, pose: NDArray[np.float64]) -> ViewsDeviation:
    """Of a pose (4, 4) in the reference frame."""
    joint = JointEvidence.from_views(example.evidence, NumbaRenderer(), example.model,
                                     example.settings)
    truth = joint.seen(example.pose)
    symmetry = example.model.symmetry
    with contextlib.ExitStack() as stack:
        contours = JointContours.opened(joint, stack, _NONE.displaced(joint.independent))
        posterior = JointPosterior(example.model, example.settings, contours, None)
        mode = posterior.refine(joint.seen(pose))
        apart = posterior.disagreement_near(mode.pose)
        displacement = posterior.displacement_at(truth)
    equivalent = symmetry.nearest_equivalents(truth[None], mode.pose)
    local = mode.local
    return ViewsDeviation(local.basis.T @ symmetry.local(equivalent, mode.pose)[0],
                          np.asarray(np.linalg.inv(local.scale * local.information), float),
                          local.model_error, joint.independent, apart, displacement)


def learned_from(found: Sequence[ViewsSearch], least_weight: float, false_alarms: float,
                 missed: float, report: Callable[[str], object]) -> LearnedViews:
    """Thresholds and model error. Raises LocalizationError for too few searches.

    The least support is one that the share `false_alarms` of objects elsewhere exceeds, the least
    evidence one that the share `missed` of right poses does not reach.
    """
    there = np.array([each.there for each in found], bool)
    right = [each for each in found if each.deviation is not None]
    if there.all() or not right:
        raise LocalizationError(f'{len(found)} searches, {len(right)} of them with a right pose, '
                                f'{int((~there).sum())} for another object: learn from more '
                                'scenes')
    clear = [each for each in found
             if each.weight >= least_weight and math.isfinite(each.support)]
    slopes = support_slopes(
        [[each.support, *-_asked(each)] for each in clear if each.deviation is not None],
        [[each.support, *-_asked(each)] for each in clear if not each.there]).round(_DIGITS)

    def margin(each: ViewsSearch) -> float:
        if each.weight < least_weight:
            return -math.inf
        return each.support - float(slopes @ _asked(each))

    margins = np.array([margin(each) for each in found])
    supports = Supports(margins[there], margins[~there],
                        np.array([each.evidence for each in right]))
    # As they are written, so that the model error is of the poses that are claimed by them.
    least = round(supports.threshold(false_alarms), _DIGITS)
    evidence = round(supports.least_evidence(missed), _DIGITS)
    report(f'least support {least:.2f} + {slopes[0]:.2f} log(1 + disagreement) + {slopes[1]:.2f} '
           f'evidence beyond + {slopes[2]:.2f} inside, at {100 * false_alarms:g} % false alarms; '
           f'{100 * supports.missed(least):.0f} % of what is there has less')
    report(f'least evidence {evidence:.2f}: {100 * missed:g} % of right poses have less')
    deviations = [each.deviation for each in right if each.deviation is not None
                  and margin(each) >= least and each.evidence >= evidence]
    displacement = math.sqrt(np.mean([each.displacement ** 2 for each in deviations]))
    learned = fitted(deviations).model_copy(update={
        'displacement': round(displacement, _DIGITS),
        'least_evidence': evidence, 'least_support': least,
        'support_slope': float(slopes[0]), 'beyond_slope': float(slopes[1]),
        'inside_slope': float(slopes[2])})
    squares = [each.square(learned) for each in deviations]
    dimensions = [len(each.deviation) for each in deviations]
    degrees = fitted_degrees_of_freedom(squares, dimensions)
    learned = learned.model_copy(update={'degrees_of_freedom': degrees})
    levels = credible_level(squares, dimensions, degrees)
    report(f'displacement of contours: {displacement:.2f} px')
    report(f'model error: {learned.error_share:.2f} of its variance, worth '
           f'{learned.error_views:.1f} views; disagreement {learned.disagreement:.3f}')
    report(f"degrees of freedom of Student's t: {degrees:g}")
    for level in (0.5, COMMON):
        report(f'truths in the {100 * level:.0f} % region: {100 * (levels <= level).mean():.0f} % '
               f'of {len(levels)}')
    return learned


def _asked(each: ViewsSearch) -> NDArray[np.float64]:
    """(3,) what more support is asked for, each for a unit of it.

    They are log(1 + disagreement), evidence beyond the contours, and the inside.
    """
    return np.array([math.log1p(each.disagreement), each.beyond, each.inside])


def fitted(given: Sequence[ViewsDeviation]) -> LearnedViews:
    """The numbers of the model error, most probable, then scaled to the nominal coverage.

    The thresholds are those of `_NONE`. Raises LocalizationError where no factor gives that
    coverage.
    """
    def numbers(logarithms: NDArray[np.float64], scale: float = 1.0) -> LearnedViews:
        share, views, apart = np.exp(np.clip(logarithms, -5, 4))
        return _NONE.model_copy(update={
            'error_share': float(f'{scale * share:.3g}'), 'error_views': float(f'{views:.3g}'),
            'disagreement': float(f'{apart / scale:.3g}')})

    def unlikely(logarithms: NDArray[np.float64]) -> float:
        total, tried = np.square(logarithms - np.log(_FIRST)).sum() / 2, numbers(logarithms)
        for each in given:
            spread = each.spread(tried)
            total += 0.5 * (each.deviation @ np.linalg.solve(spread, each.deviation)
                            + np.linalg.slogdet(spread)[1])
        return float(total)

    best = minimize(unlikely, np.log(_FIRST), method='Nelder-Mead',
                    options={'xatol': 0.01, 'fatol': 0.01}).x

    def excess(scale: float) -> float:
        levels = credible_level([each.square(numbers(best, scale)) for each in given],
                                [len(each.deviation) for each in given], math.inf)
        return float(np.quantile(levels, COMMON)) - COMMON

    if excess(_LEAST) < 0 or excess(_MOST) > 0:
        raise LocalizationError(f'{len(given)} poses do not bound the model error of several '
                                'views; learn from more scenes')
    return numbers(best, brentq(excess, _LEAST, _MOST, xtol=1e-3))
