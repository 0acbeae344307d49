"""What a soak test judges, where it is known what happened."""

import pytest

from pmcl_ros.evaluation.bench.soak_report import Soak

SHORT = list(range(50, 2001, 50))


def soaked(**values):
    after = list(range(200, 2001, 200))
    return Soak(**{'captures': 2000, 'poses': 2000, 'after': after,
                   'memory': {'node': [900.0] * len(after)}} | values)


@pytest.mark.parametrize(('values', 'words'), [
    ({}, []),
    ({'memory': {'node': [900 + 0.0005 * each for each in range(200, 2001, 200)]}}, []),
    ({'memory': {'node': [900 + 0.002 * each for each in range(200, 2001, 200)]}},
     ['node grows by 2.0 (2.0 to 2.0) MB in 1,000 captures']),
    ({'killed': 1, 'memory': {'node': [900 + 0.002 * each for each in range(200, 2001, 200)]}},
     ['node grows by 2.0 (2.0 to 2.0) MB in 1,000 captures']),
    ({'memory': {'node': [900.0, *[961.0] * 9]}}, ['node grew by 61 MB']),
    # A process that was killed grows for a while, and is judged by its own captures.
    ({'killed': 1, 'after': SHORT, 'memory': {'node': [420.0, 490.0]}}, []),
    ({'killed': 1, 'after': SHORT, 'memory': {'node': [420.0, 490.0, 551.0]}},
     ['node grew by 61 MB']),
    # A passing peak is no growth.
    ({'memory': {'node': [*[900.0] * 8, 943.0, 900.0]}}, []),
    ({'unreported': 1}, ['1 captures too few, or too many, are reported as lost']),
    ({'unreported': 2, 'killed': 1}, []),
    ({'unreported': 3, 'killed': 1},
     ['1 captures too few, or too many, are reported as lost']),
    ({'strange': 1}, ['1 poses of no capture']), ({'strange': 1, 'unanswered': 1}, []),
    ({'dropped': {'dlv_node': 2}}, ['2 captures dropped']),
])
def test_violations(values, words):
    assert soaked(**values).violations(flood=False) == words


def test_the_slope_does_not_depend_on_a_peak():
    memory = [900 + 0.0002 * each for each in range(200, 2001, 200)]
    plain = soaked(memory={'node': memory}).slopes['node']
    assert plain.slope == pytest.approx(0.2)
    memory[7] += 43
    peaked = soaked(memory={'node': memory}).slopes['node']
    assert peaked.low <= plain.slope <= peaked.high
    assert abs(peaked.slope - plain.slope) < 0.01


def test_the_table_has_ten_measurements_and_the_most():
    table = soaked(seconds=1, after=SHORT, memory={'node': [900.0] * 39 + [950.0]}).markdown()
    row, = (each for each in table.splitlines() if 'node: MB after' in each)
    assert row.endswith(f'| {"900, " * 9}950 |')
    assert 'least and most | 900, 950' in table
