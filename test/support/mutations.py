"""Damage to a file's bytes, as hypothesis draws it: bits, lengths, cuts, repetitions, nesting."""

import re

from hypothesis import strategies as st

FRACTION = st.floats(0, 1, exclude_max=True)


def flip(data, where, bit):
    place = int(where * len(data))
    return data[:place] + bytes([data[place] ^ (1 << bit)]) + data[place + 1:] if data else data


def cut(data, where):
    return data[:int(where * len(data))]


def splice(data, start, end, to):
    """Part of it, once more somewhere else."""
    start, end, to = (int(each * len(data)) for each in (start, end, to))
    return data[:to] + data[start:end] + data[to:]


def remove(data, start, end):
    start, end = sorted(int(each * len(data)) for each in (start, end))
    return data[:start] + data[end:]


def overwrite(data, where, patch):
    place = int(where * len(data))
    return data[:place] + patch + data[place + len(patch):]


def nest(data, where, bracket, depth):
    place = int(where * len(data))
    return data[:place] + bracket * depth + data[place:]


def renumber(data, where, number):
    """Another number, or a value of another kind, in place of one of its numbers."""
    found = [*re.finditer(rb'-?\d+(\.\d+)?(e-?\d+)?', data)]
    if not found:
        return data
    each = found[int(where * len(found))]
    return data[:each.start()] + number + data[each.end():]


PATCHES = st.binary(max_size=16) | st.sampled_from([
    b'\xff\xff\xff\xff', b'\x7f\xff\xff\xff', b'\xff\xff\xff\x7f', bytes(8),
    b'\0\0\0\x10\0\0\0\0', b'\x89LFC\r\n\x1a\n', b'\x89LFM\r\n\x1a\n'])
NUMBERS = st.sampled_from([
    b'-1', b'0', b'1e999', b'-1e999', b'nan', b'.inf', b'.nan', b'1e-320', b'1e300', b'3.5',
    b'99999999999999999999', b'9' * 5000, b'2147483648', b'null', b'true', b'[]', b'{}', b'"x"',
    b'1:1:1', b'2026-99-99', b'*a', b'&a 1', b'<<', b'!!binary x', b'"\\ud800"', b'\x1b[31m'])
STEPS = st.one_of(
    st.tuples(st.just(flip), FRACTION, st.integers(0, 7)), st.tuples(st.just(cut), FRACTION),
    st.tuples(st.just(splice), FRACTION, FRACTION, FRACTION),
    st.tuples(st.just(remove), FRACTION, FRACTION),
    st.tuples(st.just(overwrite), FRACTION, PATCHES),
    st.tuples(st.just(renumber), FRACTION, NUMBERS),
    st.tuples(st.just(nest), FRACTION, st.sampled_from([b'[', b'{', b'{"a":', b'- ', b'(']),
              st.sampled_from([3, 100, 100_000])))
MUTATIONS = st.lists(STEPS, min_size=1, max_size=4)


def mutated(data, steps):
    for step, *arguments in steps:
        data = step(data, *arguments)
    return data
