"""How far contours lie off, from poses whose errors were drawn."""

import numpy as np
import pytest

from pmcl_ros.geometry.student_t import COMMON, credible_level
from pmcl_ros.learning.contour_errors import (
    Deviation,
    fitted_degrees_of_freedom,
    fitted_error,
    fitted_offset,
)
from pmcl_ros.runtime.errors import LocalizationError

COUNT = 400


def drawn(common, local, seed=0, tails=np.inf, offset=0.0):
    """Deviations by noise and model errors of these sizes; tails: freedoms of Student's t.

    offset: of all contours [px].
    """
    rng = np.random.default_rng(seed)
    found = []
    for _ in range(COUNT):
        roots = rng.normal(size=(3, 5, 5)) * np.array([0.001, 0.004, 0.003])[:, None, None]
        noise, of_common, of_local = (root @ root.T for root in roots)
        spread = noise + common ** 2 * of_common + local ** 2 * of_local
        size = 1.0 if np.isinf(tails) else np.sqrt(tails / rng.chisquare(tails))
        moved = roots[1].sum(axis=1)
        deviation = size * rng.multivariate_normal(np.zeros(5), spread) - offset * moved
        found.append(Deviation(deviation, noise, of_common, of_local, moved))
    return found


@pytest.mark.parametrize(('common', 'local'), [(0.2, 0.4), (0.5, 0.15)])
def test_the_sizes_of_errors_are_recovered(common, local):
    error = fitted_error(drawn(common, local))
    assert error.common == pytest.approx(common, rel=0.15)
    assert error.local == pytest.approx(local, rel=0.15)


@pytest.mark.parametrize('offset', [0.0, -0.3])
def test_where_contours_are_found_is_recovered(offset):
    assert fitted_offset(drawn(0.2, 0.4, offset=offset)) == pytest.approx(offset, abs=0.03)


@pytest.mark.parametrize('tails', [3.0, 6.0])
def test_with_long_tails_the_regions_hold_as_many_as_they_say(tails):
    def squares(given):
        return [each.square(error.common, error.local) for each in given]

    found = drawn(0.2, 0.4, tails=tails)
    error = fitted_error(found)
    levels = credible_level(squares(found), 5, np.inf)
    assert (levels <= COMMON).mean() == pytest.approx(COMMON, abs=0.01)
    assert error.common > 0.2
    degrees = fitted_degrees_of_freedom(squares(found), [5] * COUNT)
    assert degrees == pytest.approx(tails, rel=0.3)
    fresh = squares(drawn(0.2, 0.4, seed=1, tails=tails))
    levels = credible_level(fresh, 5, degrees)
    for level in (0.25, 0.5, 0.75, COMMON):
        assert (levels <= level).mean() == pytest.approx(level, abs=0.06)
    assert (credible_level(fresh, 5, np.inf) <= 0.5).mean() > 0.55


def test_gaussian_errors_have_no_tails():
    found = drawn(0.2, 0.4)
    squares = [each.square(0.2, 0.4) for each in found]
    assert fitted_degrees_of_freedom(squares, [5] * COUNT) > 30


def test_a_distance_is_in_standard_deviations():
    noise = np.diag([1.0, 4, 9, 16, 25])
    off = Deviation(np.sqrt(np.diag(noise)), noise, np.eye(5), np.eye(5), np.zeros(5))
    assert off.square(0, 0) == pytest.approx(5)
    assert off.square(1, 0) == pytest.approx(off.square(0, 1))
    assert off.square(1, 0) < off.square(0, 0)


def test_nothing_is_learned_from_nothing():
    with pytest.raises(LocalizationError, match='0 poses'):
        fitted_error([])
    with pytest.raises(LocalizationError, match='0 poses'):
        fitted_offset([])
