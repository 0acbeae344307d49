"""What objects are called: distinct, and as ROS takes names of topics."""

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pmcl_ros.pmcl.multi_object.scene_localizer import distinct_names
from pmcl_ros.runtime.errors import LocalizationError


def test_copies_are_numbered_and_what_ros_does_not_take_is_replaced():
    assert distinct_names(['glass', 'jar', 'glass', 'glass']) == ['glass', 'jar', 'glass_2',
                                                                  'glass_3']
    assert distinct_names(['wine glass-4.a', '3m', '...']) == ['wine_glass_4_a', 'object_3m',
                                                               'object']


@pytest.mark.parametrize(('names', 'words'), [
    ([], 'no objects'), (['a b', 'a-b'], "'a_b'"), (['jar', 'jar', 'jar_2'], 'jar_2')])
def test_names_that_would_be_alike_are_refused(names, words):
    with pytest.raises(LocalizationError, match=words):
        distinct_names(names)


@given(st.lists(st.text(max_size=8), min_size=1, max_size=5))
def test_whatever_files_are_called_topics_are_possible(names):
    try:
        made = distinct_names(names)
    except LocalizationError:
        return
    assert len(set(made)) == len(names)
    for each in made:
        assert re.fullmatch(r'[A-Za-z][A-Za-z0-9_]*', each)
        assert '__' not in each
