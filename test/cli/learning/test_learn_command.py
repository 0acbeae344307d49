"""`pmcl learn` writes the data file that is read at start."""

import numpy as np
import pytest
import yaml
from command_line import Runner, pmcl

from pmcl_ros.cli import main
from pmcl_ros.evidence.learned import LearnedContour, LearnedProfile


def test_the_file_holds_what_is_printed(tmp_path):
    scenes, out = tmp_path / 'scenes', tmp_path / 'creases.yaml'
    made = Runner().invoke(main, ['scenes', 'render', '--count', '2', '--views', '3', '--size',
                                     '96', '--samples', '1', '--kind', 'opaque block', '-o',
                                     str(scenes)])
    assert made.exit_code == 0, made.output
    done = Runner().invoke(main, ['learn', str(scenes), '--views', '3', '--creases', '--out',
                                     str(out)])
    assert done.exit_code == 0, done.output
    numbers = LearnedProfile.load(out)
    rows = [line.strip() for line in done.stdout.splitlines() if line.startswith('    (')]
    assert rows == [f'({", ".join(f"{each:.2f}" for each in row)}),' for row in numbers.tables]
    assert f'bias {numbers.bias:.2f}' in done.stdout
    assert np.any(numbers.tables)
    assert f'# pmcl learn {scenes} --views 3 --seed 0 --creases --out {out}' in out.read_text()


@pytest.fixture(scope='module')
def captures_of_several_views(tmp_path_factory):
    folder = tmp_path_factory.mktemp('views')
    (folder / 'camera.yaml').write_text(yaml.safe_dump(
        {'width': 64, 'height': 48, 'fx': 60.0, 'cx': 31.5, 'cy': 23.5}))
    pmcl('scenes', 'render', '--camera', folder / 'camera.yaml', '--cameras', 'arc:2:40',
         '--samples', 1, '--count', 1, '-o', folder / 'scenes')
    return folder / 'scenes'


@pytest.mark.parametrize('more', [(), ('--creases',), ('--map',)])
def test_captures_of_several_views_are_for_posed(captures_of_several_views, more):
    done = pmcl('learn', captures_of_several_views, *more, status=1)
    assert 'has several views; learn from them with --posed' in done.stderr


def test_processes_learn_the_same(tmp_path):
    pmcl('scenes', 'render', '--views', 3, '--size', 96, '--samples', 1, '--kind', 'opaque',
         '--count', 4, '--seed', 3, '-o', tmp_path / 'scenes')
    learned = []
    for jobs in (1, 2):
        out = tmp_path / f'{jobs}.yaml'
        pmcl('learn', tmp_path / 'scenes', '--views', 3, '--jobs', jobs, '--out', out)
        learned.append(LearnedContour.load(out))
    assert learned[0] == learned[1]
