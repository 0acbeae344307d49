"""What `pmcl warm-up` compiles is what a localisation needs: that of a shipped bag."""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
from command_line import pmcl_process

from pmcl_ros.geometry.truth import Truth
from pmcl_ros.runtime import kernels

BAG = Path(__file__).parents[2] / 'bags' / 'wine_glass'
AFTERWARDS = """
import atexit, sys
from pmcl_ros.cli import main
from pmcl_ros.runtime import kernels
compiled = []
kernels.report_to(compiled.append)
atexit.register(lambda: print('compiled:', *compiled))
main(['warm-up', '--all'], standalone_mode=False)
print('warmed up')
main(['report', *sys.argv[1:]])
"""


def text_of(page, name):
    return re.search(f'id="{name}">(.*?)<', page).group(1)


def test_after_it_a_bag_is_reported_on_by_its_name_and_nothing_is_compiled(tmp_path):
    for complete in kernels.cache_folder().glob('*.complete'):
        complete.unlink()  # as on a machine where none ran to its end
    assert 'compiled' in pmcl_process('warm-up', '--all').stderr
    out = tmp_path / 'new' / 'glass.html'
    done = subprocess.run([sys.executable, '-c', AFTERWARDS, BAG, '-o', out], check=True,
                          capture_output=True, text=True)
    first, *_, path, compiled = done.stdout.splitlines()
    assert first == 'warmed up'
    assert 'compil' not in done.stderr
    assert path == str(out)
    assert compiled.split() == ['compiled:']
    page = out.read_text(encoding='utf-8')
    assert text_of(page, 'verdict') == 'Found'
    position = [float(text_of(page, name).removesuffix(' mm')) for name in 'xyz']
    assert np.linalg.norm(position - 1e3 * Truth.load(BAG / 'truth.json').pose[:3, 3]) < 20
    for told in ('A000000001', 'lytro_optical_frame', '9 x 9 of 328 x 328 px'):
        assert told in page
