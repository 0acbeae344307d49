"""`pmcl track`: played sequences, and what is said of them."""

import numpy as np
import pytest
from click.testing import CliRunner

from pmcl_ros.cli import main
from pmcl_ros.evaluation.studies.tracking import Outcome, Played, play
from pmcl_ros.evaluation.studies.tracking_table import picture, recoveries, recovery, row, table
from pmcl_ros.simulation.sequence import Sequence, SequenceSettings

TINY = SequenceSettings(frames=5, occluded=1, size=128, object_speed=0.008)


def outcome(mm, lost=False, seconds=0.1, way='followed'):
    return Outcome(way, 1e-3 * mm, 0.01, 0.5, 0.003, lost, seconds, seconds)


def played(*errors, hidden=(), every=1):
    """Frames of these errors [mm] (None: lost); single shots of 4 mm, a second each."""
    return [Played(k, k in hidden, outcome(50, lost=True) if mm is None else outcome(mm),
                   outcome(4, seconds=1.0) if k % every == 0 else None, 0.2)
            for k, mm in enumerate(errors)]


@pytest.mark.parametrize(('frames', 'expected'), [
    (played(1, None, None, 2, hidden=(1, 2)), 1),
    (played(1, None, None, None, 90, 3, hidden=(1, 2)), 3),  # what is claimed elsewhere is none
    (played(1, None, None, None, hidden=(1, 2)), None),
    (played(1, None, hidden=(1,)), -1),
    (played(1, 2), -1),
])
def test_recovery_counts_frames_until_it_is_found_again(frames, expected):
    assert recovery(frames) == expected


def test_recoveries_are_told_in_words():
    assert recoveries([1, 3, 4, None, -1]) == (
        'found within three frames after the occlusion: 2 of 4 (in frame 1, 3, 4, never)')
    assert recoveries([-1]) == 'nothing was occluded'


def test_a_row_compares_frames_that_were_looked_at_both_ways():
    frames = played(1, 9, 3, None, 7, 60, hidden=(3,), every=2)
    line = row('name', frames)
    assert line['error tracked [mm]'] == '3.0'  # of 1, 3 and 7
    assert line['single [mm]'] == '4.0'
    assert line['more [mm]'] == '-1.00 ± 1.61'  # median of -3, -1 and 3, quartiles -2 and 1
    assert line['times as fast'] == '10.0'
    assert line['wrong'] == '1'
    assert line['claimed while hidden'] == '0 of 1'
    text = table([line, line]).splitlines()
    assert len(text) == 4
    assert len({each.count('|') for each in text}) == 1


def test_the_picture_shows_errors_where_something_is_claimed():
    frames = played(1, None, 3, 2, hidden=(1,))
    drawn = picture('name', frames)
    without = picture('name', played(1, None, 3, 2.5, hidden=(1,)))
    assert drawn.dtype == np.uint8
    assert (drawn != without).any()


def test_a_sequence_is_tracked_beside_single_shots():
    sequence = Sequence(4, TINY)
    told = []
    frames = play(sequence, 'constant_pose', 3, told=told.append)
    assert told == frames
    assert [each.single is not None for each in frames] == [True, False, False, True, False]
    assert [each.occluded for each in frames] == [False, False, True, False, False]
    assert frames[1].tracked.way == 'followed'
    assert frames[1].tracked.right


def test_the_command_prints_and_writes_what_was_found(tmp_path):
    done = CliRunner().invoke(main, ['track', '--count', '1', '--frames', '3', '--occluded', '0',
                                     '--size', '96', '--every', '3', '--out',
                                     str(tmp_path / 'out')])
    assert done.exit_code == 0, done.output
    assert (tmp_path / 'out' / 'track.md').read_text() in done.output
    assert (tmp_path / 'out' / 'track_000.png').stat().st_size > 1000
