from hypothesis import given
from hypothesis import strategies as st

from pmcl_ros.nodes.camera_input import most_waiting


@given(st.integers(0, 2 ** 30))
def test_a_hundred_pictures_may_wait_or_as_many_as_256_mib_hold_but_always_one(size):
    most = most_waiting(size)
    assert 1 <= most <= 100
    assert most * size <= 2 ** 28 or most == 1
    assert (most + 1) * size > 2 ** 28 or most == 100
