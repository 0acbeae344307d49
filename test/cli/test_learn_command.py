"""`pmcl learn` writes the data file that is read at start."""

import numpy as np
from command_line import Runner

from pmcl_ros.cli import main
from pmcl_ros.evidence.learned import LearnedProfile


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
