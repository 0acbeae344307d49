"""Learned numbers are read from data files; what is wrong in one is named."""

import subprocess
import sys

import numpy as np
import pytest

from pmcl_ros.evidence.contour_profile import ContourProfile
from pmcl_ros.evidence.learned import (
    MOST_KNOTS,
    MOST_OFFSETS,
    LearnedContour,
    LearnedProfile,
    learned_contour,
    learned_creases,
    learned_file,
)
from pmcl_ros.evidence.model_error import ModelError
from pmcl_ros.pmcl.render.contour import check_profile
from pmcl_ros.pmcl.settings import PmclSettings
from pmcl_ros.runtime.errors import RenderError, SettingsError

GOOD = {'offsets': [-1, 0, 1], 'knots': [0, 0.5], 'tables': [[0, 1], [2, 3], [4, 5]], 'bias': 0.1}


def test_the_files_are_what_the_search_uses():
    numbers = learned_contour()
    profile = ContourProfile.learned()
    np.testing.assert_array_equal(profile.tables, np.array(numbers.tables, np.float32))
    assert (profile.bias, profile.least) == (numbers.bias, numbers.least_evidence)
    assert PmclSettings().least_support == numbers.least_support
    assert ModelError.learned() == ModelError(numbers.common_error, numbers.local_error,
                                              numbers.error_length)


def test_creases_have_no_side():
    tables = np.array(learned_creases().tables)
    np.testing.assert_array_equal(tables, tables[::-1])
    np.testing.assert_array_equal(ContourProfile.learned_creases().tables,
                                  tables.astype(np.float32))


def test_what_is_saved_is_read_to_the_last_digit(tmp_path):
    file = tmp_path / 'contour.yaml'
    numbers = learned_contour().model_copy(update={'bias': 1 / 3, 'least_evidence': 1e-7})
    numbers.save(file, 'pmcl learn out')
    assert LearnedContour.load(file) == numbers
    assert file.read_text().startswith('# pmcl learn out\n')


@pytest.mark.parametrize(('change', 'reason'), [
    ({'knots': [0.1, 0.5]}, 'knots must begin at 0'),
    ({'knots': [0, 0]}, r'knots must ascend, they are \[0.0, 0.0\]'),
    ({'offsets': [0, -1, 1]}, 'offsets must ascend'),
    ({'tables': [[0, 1], [2, 3]]}, 'tables must have 3 rows'),
    ({'tables': [[0, 1], [2, 3], [4]]}, r'of 2 numbers \(knots\), they have 3 rows of \[1, 2\]'),
    ({'bias': float('nan')}, 'bias: Input should be a finite number'),
    ({'tables': [[0, 1], [2, 3], [4, float('inf')]]}, 'tables.2.1: Input should be a finite'),
    ({'offsets': list(range(9))}, 'offsets: Tuple should have at most 8 items'),
    ({'knots': list(range(10))}, 'knots: Tuple should have at most 9 items'),
    ({'bia': 1}, 'bia: there is no such key'),
])
def test_the_file_and_the_field_are_named(tmp_path, change, reason):
    file = tmp_path / 'creases.yaml'
    file.write_text(str(GOOD | change).replace('nan', '.nan').replace('inf', '.inf'))
    with pytest.raises(SettingsError, match=f'{file}: .*{reason}'):
        LearnedProfile.load(file)


def test_what_is_read_is_no_larger_than_scores_are_made_for():
    def profile(offsets, knots):
        return ContourProfile(np.arange(offsets), np.arange(knots), np.zeros((offsets, knots)))

    check_profile(profile(MOST_OFFSETS, MOST_KNOTS))
    for size in ((MOST_OFFSETS + 1, MOST_KNOTS), (MOST_OFFSETS, MOST_KNOTS + 1)):
        with pytest.raises(RenderError, match='scores take 8 offsets at most and 2 to 9 knots'):
            check_profile(profile(*size))


def test_another_folder_is_read_in_place_of_the_shipped_one(tmp_path, monkeypatch):
    monkeypatch.setenv('PMCL_LEARNED', str(tmp_path))
    with pytest.raises(SettingsError, match=f'there is no {tmp_path / "views.yaml"}'):
        learned_file('views.yaml')
    (tmp_path / 'views.yaml').touch()
    assert learned_file('views.yaml') == tmp_path / 'views.yaml'


def test_without_a_file_the_error_says_where_it_should_be(package_tree):
    file = package_tree / 'config' / 'learned' / 'creases.yaml'
    file.unlink()
    done = subprocess.run([sys.executable, '-c', 'from pmcl_ros.evidence import learned\n'
                           'learned.learned_contour()\nlearned.learned_creases()'],
                          cwd=package_tree, capture_output=True, text=True, check=False)
    assert (f'SettingsError: learned numbers: there is no {file}; reinstall the package, or learn '
            'them again with pmcl learn') in done.stderr
