"""Two studies are compared cell by cell."""

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from pmcl_ros.cli import main
from pmcl_ros.evaluation.feasibility.comparison import Pair, pairs, studied, verdict
from pmcl_ros.evaluation.feasibility.findings import Aim
from pmcl_ros.evaluation.trials import Trial
from pmcl_ros.runtime.errors import FileError


def write_study(folder: Path, good: Sequence[bool]) -> Path:
    """A study with one and two views: 'table' and 'sink' by turns, farther with the seed."""
    for seed, right in enumerate(good):
        scene = folder / 'scenes' / f'{seed:06d}'
        scene.mkdir(parents=True)
        trials = {name: asdict(Trial(
            f'{("table", "sink")[seed % 2]}: glass', name, seed, pose=(0.0,) * 12, axis_deg=1.0,
            translation_mm=1.0 if right or name == 'two views' else 9.0,
            extra={'distance': 0.3 + 0.01 * seed if name == 'one view' else 0.9}))
            for name in ('one view', 'two views')}
        (scene / 'trials.json').write_text(json.dumps(trials))
    return folder


def pair(first: tuple[int, int], second: tuple[int, int]) -> Pair:
    """Of counts: good ones, all."""
    return Pair('one view', 'all', *([True] * good + [False] * (count - good)
                                     for good, count in (first, second)))


def test_cells_are_of_the_same_scenes_in_both_studies(tmp_path: Path) -> None:
    first = studied(write_study(tmp_path / 'first', [k % 3 > 0 for k in range(60)]))
    second = studied(write_study(tmp_path / 'second', [k % 2 > 0 for k in range(60)]))
    compared = {(each.views, each.scenes): each for each in pairs(first, second, Aim())}
    assert [scenes for views, scenes in compared if views == 'one view'] == [
        'all', '0.30 to 0.50 m', '0.50 to 0.69 m', '0.69 to 0.89 m', 'sink', 'table']
    assert compared['one view', 'all'].row()[2:] == [
        '67 % (40 of 60; 54 to 77 %)', '50 % (30 of 60; 38 to 62 %)', '-17']
    assert compared['one view', 'sink'].difference == pytest.approx(100 - 100 * 20 / 30)
    assert compared['two views', 'all'].difference == 0
    # Of sixty scenes the ranges have twenty; with one less in the other study they do not count.
    fewer = {name: trials[:59] for name, trials in second.items()}
    assert ('one view', '0.69 to 0.89 m') not in {
        (each.views, each.scenes) for each in pairs(first, fewer, Aim())}


def test_scenes_are_counted_once_where_all_are_in_one_place(tmp_path: Path) -> None:
    study = studied(write_study(tmp_path / 'study', [True] * 40))
    tables = {name: [each for each in trials if each.capture == 'table: glass']
              for name, trials in study.items()}
    assert [(each.views, each.scenes) for each in pairs(tables, tables, Aim())] == [
        ('one view', 'all'), ('two views', 'all')]


def test_chance_is_how_often_equal_rates_are_alike() -> None:
    rng, (few, many, rate) = np.random.default_rng(0), (33, 67, 0.7)
    shares = (rng.binomial(few, rate, 200000) / few, rng.binomial(many, rate, 200000) / many)
    drawn = (np.abs(shares[0] - shares[1]) <= 0.1).mean()
    assert pair((23, few), (47, many)).chance == pytest.approx(drawn, abs=0.004)
    assert pair((20, 20), (20, 20)).chance == pytest.approx(1)


def test_ten_points_are_alike_and_more_are_not() -> None:
    assert pair((10, 20), (12, 20)).alike
    assert not pair((10, 20), (13, 20)).alike
    assert not pair((13, 20), (10, 20)).alike
    # Rounding decides nothing: 80 and 70 % are ten points apart.
    assert all(pair((k, 20), (k + 2, 20)).alike for k in range(19))
    assert pair((200, 300), (199, 300)).row()[-1] == '+0'
    assert verdict([pair((10, 20), (12, 20)), pair((10, 20), (13, 20))]).startswith(
        '1 of 2 cells with 20 scenes or more (50 %) differ by at most 10 points.')
    assert verdict([]).startswith('Nothing to compare')


def test_the_command_prints_cells_and_verdict(tmp_path: Path) -> None:
    for name in ('a', 'b'):
        write_study(tmp_path / name, [k % 3 > 0 for k in range(20)])
    done = CliRunner().invoke(main, ['compare', str(tmp_path / 'a'), str(tmp_path / 'b')])
    assert done.exit_code == 0, done.output
    share = '65 % (13 of 20; 43 to 82 %)'
    assert f'| one view | all | {share} | {share} | +0 |' in done.output
    assert '2 of 2 cells' in done.output
    strict = CliRunner().invoke(main, ['compare', str(tmp_path / 'a'), str(tmp_path / 'b'),
                                       '--within', '0.5'])
    assert '| one view | all | 0 % (0 of 20; 0 to 16 %)' in strict.output


def test_a_folder_without_a_study_is_told(tmp_path: Path) -> None:
    with pytest.raises(FileError, match='has no trials of scenes; name the --out of pmcl feas'):
        studied(tmp_path)


@pytest.mark.parametrize('text', ['{"one view": 3}', '{"one view": {"pose": []}}', '[]', '{',
                                  '{"one view": {"capture": "table", "mode": "", "seed": 1, '
                                  '"pose": []}}', '{"one view": {"pose": [], "no": 1}}'])
def test_a_file_without_trials_is_told(tmp_path: Path, text: str) -> None:
    study = write_study(tmp_path / 'study', [True] * 3)
    damaged = study / 'scenes' / '000001' / 'trials.json'
    damaged.write_text(text)
    with pytest.raises(FileError, match=r'000001/trials\.json'):
        studied(study)
