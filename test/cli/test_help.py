"""`pmcl --help` is there at once: it imports no command; a command imports what it needs."""

import subprocess
import sys

import pytest
from click import Context
from command_line import pmcl

from pmcl_ros.cli import main

HELP = """
import sys
from pmcl_ros.cli import main
*command, libraries = sys.argv[1:]
main([*command, '--help'], standalone_mode=False)
print(*sorted(set(libraries.split(',')) & set(sys.modules)))
"""


@pytest.mark.parametrize('arguments', [('numpy,numba,scipy,cv2',), ('bag', 'trimesh,matplotlib'),
                                       ('decode', 'trimesh,matplotlib'),
                                       ('profile', 'matplotlib')])
def test_help_needs_none_of_the_large_libraries(arguments):
    done = subprocess.run([sys.executable, '-c', HELP, *arguments], check=True,
                          capture_output=True, text=True)
    assert done.stdout.splitlines()[-1] == ''
    assert not done.stderr


def test_every_command_is_listed_once_with_a_line():
    lines = [line.split(maxsplit=1) for line in pmcl('--help').output.splitlines()]
    listed = dict(each for each in lines if len(each) == 2)
    for name in main.list_commands(Context(main)):
        assert sum(each[:1] == [name] for each in lines) == 1
        assert listed[name].endswith('.')


@pytest.mark.parametrize('name', main.list_commands(Context(main)))
def test_every_name_is_a_command_with_help_of_its_own(name):
    command = main.get_command(Context(main), name)
    assert command.name == name
    assert command.help


def test_the_help_of_localize_describes_the_evidence_that_it_takes():
    command = main.get_command(Context(main), 'localize')
    evidence, = (each for each in command.params if '--evidence' in each.opts)
    assert 'auto' not in evidence.help
    assert 'dlv/' not in evidence.help
    assert all(each in evidence.help for each in ('edges', 'map', 'by default'))
