"""Trials in several processes are those of one; what can be shared follows each other."""

from dataclasses import asdict, replace
from itertools import groupby

import numpy as np
import pytest
from pmcl_scenes import bracket
from tiny_capture import QUICK, write_capture

from pmcl_ros.evaluation.captures import find_captures
from pmcl_ros.evaluation.pool import run_jobs
from pmcl_ros.evaluation.trial_plan import TrialPlan
from pmcl_ros.evaluation.variants import Variant
from pmcl_ros.reading import Reading
from pmcl_ros.runtime.errors import PmclError, SettingsError

TIMES = {'seconds': 0.0, 'dlv_seconds': 0.0, 'decode_seconds': 0.0, 'renderer': ''}
ROW = (Variant.parse(QUICK),)


@pytest.fixture(scope='module')
def captures(tmp_path_factory):
    folder = tmp_path_factory.mktemp('tiny')
    write_capture(folder / 'glass', seed=1)
    write_capture(folder / 'thing', seed=2, mesh=bracket(), film=True)
    write_capture(folder / 'nothing', empty=True)
    return find_captures(folder)


def made(plan, processes):
    """The trials but for their times, by what they are."""
    jobs = plan.jobs()
    trials = [replace(each, **TIMES) for each in run_jobs(jobs, None, processes)]
    assert len(trials) == len(jobs)
    return {(each.capture, each.mode, each.sought, each.seed): each for each in trials}


def test_two_processes_make_the_trials_of_one(captures):
    # With how each is read, which commands tell by options.
    read = [replace(each, reading=Reading(shrink=2)) if each.name == 'nothing' else each
            for each in captures]
    plan = TrialPlan(tuple(read), ROW, (0,), tuple(captures[:1]))
    alone, together = made(plan, 1), made(plan, 2)
    assert alone.keys() == together.keys()
    assert len(alone) == 3 + 1  # in each capture, and the glass where the thing is
    for key, trial in alone.items():
        for name, value in asdict(trial).items():  # bit for bit; NaN is equal to itself
            np.testing.assert_array_equal(getattr(together[key], name), value, name)
    for (capture, _, sought, _), trial in alone.items():
        assert trial.wrong == (trial.empty is False and sought != capture)
        assert trial.present == (trial.translation_mm == trial.translation_mm)
    assert {each.film for key, each in alone.items() if key[0] == 'thing'} == {True}
    widths = {each.capture: each.width_px for each in together.values()}
    assert widths == {'glass': 112, 'thing': 112, 'nothing': 56}
    glass = next(each for each in alone.values() if each.capture == each.sought == 'glass')
    off = np.reshape(glass.pose, (3, 4))[:, 3] - captures[0].truth.pose[:3, 3]
    assert glass.translation_mm == pytest.approx(1e3 * np.linalg.norm(off))
    assert glass.mssd_mm >= glass.translation_mm  # the origin is inside the glass


def test_each_seed_looks_for_another_wrong_object(captures):
    jobs = TrialPlan((captures[0],), ROW, (0, 1, 2), tuple(captures)).jobs()
    assert [(job.seed, job.sought.name) for job in jobs if job.sought.name != 'glass'] == [
        (0, 'thing'), (1, 'thing'), (2, 'thing')]  # `nothing` has the model that is there
    assert len(jobs) == 6


def test_each_capture_looks_for_another_wrong_object(captures, tmp_path):
    """One that resembles many would else decide how often wrong objects are claimed."""
    glass, others = captures[0], []
    for number in range(4):
        folder = tmp_path / str(number)
        folder.mkdir()
        (folder / 'model.obj').write_text(f'# {number}')
        others.append(replace(glass, folder=folder, source=folder, name=str(number)))
    jobs = TrialPlan(tuple(others), ROW, (0, 1), tuple(others)).jobs()
    for seed in (0, 1):
        sought = [job.sought.name for job in jobs
                  if job.seed == seed and job.sought != job.capture]
        assert sorted(sought) == ['0', '1', '2', '3']


def test_jobs_of_one_volume_follow_each_other(captures):
    rows = (Variant.parse('moves=2'), Variant.parse('labels=9'), Variant.parse('moves=3'),
            Variant.named('faithful'))
    jobs = TrialPlan(tuple(captures[:1]), rows, (0, 1), tuple(captures)).jobs()
    assert len(jobs) == 4 * 2 * 2
    keys = [(job.sought.name, {'moves=2': 'plain', 'moves=3': 'plain'}.get(
        job.variant.name, job.variant.name)) for job in jobs]
    assert len(list(groupby(keys))) == len(set(keys)) == 2 * 3


@pytest.mark.parametrize('processes', [1, 2])
def test_a_capture_that_fails_is_named_and_the_others_go_on(captures, caplog, processes):
    glass, thing, nothing = captures[0], captures[2], captures[1]
    far = replace(glass, truth=replace(glass.truth, roi_center=(9.0, 9.0, 0.4)))
    trials = run_jobs(TrialPlan((far, thing, nothing), ROW, (0, 1)).jobs(), None, processes)
    made = []
    with pytest.raises(PmclError, match=r'^1 of 3 captures failed, as said above: glass$'):
        made.extend(trials)
    assert sorted((each.capture, each.seed) for each in made) == [
        ('nothing', 0), ('nothing', 1), ('thing', 0), ('thing', 1)]
    told, = (each.getMessage() for each in caplog.records if each.levelname == 'ERROR')
    assert told.startswith('glass: ')
    assert 'outside the image' in told


def test_impossible_settings_are_of_no_capture(captures):
    with pytest.raises(SettingsError, match='moves'):
        next(run_jobs(TrialPlan(tuple(captures), (Variant.parse('moves=0'),), (0,)).jobs(), None,
                      1))
