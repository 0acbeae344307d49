import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from pmcl_ros.camera.gateway.handler import UnsatisfiableError, selected

DATA = bytes(range(20))
NUMBERS = st.integers(0, 30)


@given(NUMBERS, NUMBERS, st.integers(0, 20))
def test_first_and_last(first, last, size):
    expected = [each for each in range(size) if first <= each <= last]
    try:
        found = selected(f'bytes={first}-{last}', size)
    except UnsatisfiableError:
        found = range(0)
        assert first <= last
    assert list(found or []) == expected
    assert (found is None) == (last < first)


@given(NUMBERS, st.integers(0, 20))
def test_from_a_byte_to_the_end_and_the_last_bytes(count, size):
    for header, expected in ((f'bytes={count}-', DATA[:size][count:]),
                             (f'bytes=-{count}', DATA[max(0, size - count):size])):
        if expected:
            found = selected(header, size)
            assert DATA[found.start:found.stop] == expected
        else:
            with pytest.raises(UnsatisfiableError):
                selected(header, size)


@pytest.mark.parametrize('header', [
    None, '', 'bytes', 'bytes=', 'bytes=-', 'bytes=a-b', 'bytes=1-2,4-5', 'items=0-1',
    'bytes=+1-2', 'bytes=1-2-3', f'bytes={10 ** 20}-', 'bytes=٣-٤'])
def test_what_is_not_understood_is_ignored(header):
    assert selected(header, 20) is None


@given(st.text(max_size=20) | st.from_regex(r'bytes=[-0-9, ]*', fullmatch=True),
       st.integers(0, 20))
@example('bytes=0-', 0)
def test_any_header_gives_a_part_or_none_or_the_error(header, size):
    try:
        found = selected(header, size)
    except UnsatisfiableError:
        return
    assert found is None or (found.step == 1 and 0 <= found.start < found.stop <= size)
