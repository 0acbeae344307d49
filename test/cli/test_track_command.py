"""`pmcl track`: played sequences, and what is said of them."""

import numpy as np
import pytest
from click.testing import CliRunner

from pmcl_ros.cli import main
from pmcl_ros.evaluation.studies.tracking import (
    SINGLE,
    TRACKED,
    picture,
    play,
    recoveries,
    recovery,
    row,
)
from pmcl_ros.evaluation.trials import Trial
from pmcl_ros.simulation.sequence import Sequence, SequenceSettings

TINY = SequenceSettings(frames=5, occluded=1, size=128, object_speed=0.008)


def trial(number, mode, mm, hidden=False, seconds=0.1):
    """mm: its error; None: lost."""
    return Trial(str(number), mode, 0, empty=hidden, translation_mm=50 if mm is None else mm,
                 axis_deg=0.6, credible_level=0.5, lost=mm is None, seconds=seconds,
                 dlv_seconds=0.2,
                 extra={'way': 'followed', 'sigma_mm': 3, 'cpu_seconds': seconds})


def played(*errors, hidden=(), every=1):
    """Trials of frames of these errors [mm]; single shots of 4 mm, a second each."""
    trials = []
    for k, mm in enumerate(errors):
        trials.append(trial(k, TRACKED, mm, k in hidden))
        if k % every == 0:
            trials.append(trial(k, SINGLE, 4, k in hidden, 1.0))
    return trials


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
    line = row('name', [frames])
    assert line['error tracked [mm]'] == '3.0'  # of 1, 3 and 7
    assert line['single [mm]'] == '4.0'
    assert line['more [mm]'] == '-1.00 ± 1.61'  # median of -3, -1 and 3, quartiles -2 and 1
    assert line['times as fast'] == '10.0'
    assert line['wrong'] == '1'
    assert line['claimed while hidden'] == '0 of 1'
    assert row('name', [frames, frames])['followed'] == '10 of 10'


def test_the_picture_shows_errors_where_something_is_claimed():
    frames = played(1, None, 3, 2, hidden=(1,))
    drawn = picture('name', frames)
    without = picture('name', played(1, None, 3, 2.5, hidden=(1,)))
    assert drawn.dtype == np.uint8
    assert (drawn != without).any()


def test_a_sequence_is_tracked_beside_single_shots():
    trials = list(play(Sequence(4, TINY), 'constant_pose', 3))
    assert [each.capture for each in trials if each.mode == SINGLE] == ['0', '3']
    tracked = [each for each in trials if each.mode == TRACKED]
    assert [each.empty for each in tracked] == [False, False, True, False, False]
    assert tracked[1].extra['way'] == 'followed'
    assert tracked[1].found


def test_the_command_prints_and_writes_what_was_found(tmp_path):
    done = CliRunner().invoke(main, ['track', '--count', '1', '--frames', '3', '--occluded', '0',
                                     '--size', '96', '--every', '3', '--out',
                                     str(tmp_path / 'out')])
    assert done.exit_code == 0, done.output
    assert (tmp_path / 'out' / 'track.md').read_text() in done.output
    assert (tmp_path / 'out' / 'track_000.png').stat().st_size > 1000
