"""The log on the terminal: lines that can be copied."""

import logging

import pytest

from pmcl_ros.cli.log import TerminalLog


@pytest.mark.parametrize('columns', ['40', '200'])
def test_a_long_message_is_one_line(capsys, monkeypatch, columns):
    monkeypatch.setenv('COLUMNS', columns)
    told = (f'{"glass/" * 20}glass.stl: nothing says the unit of the mesh; [to confirm that], '
            'write glass.yaml with "mesh: glass.stl" and "scale: 0.001"')
    TerminalLog().handle(logging.makeLogRecord(
        {'msg': '%s', 'args': (told,), 'levelno': logging.WARNING, 'levelname': 'WARNING'}))
    line, rest = capsys.readouterr().err.split('\n')
    assert line.endswith(f' WARNING {told}')
    assert rest == ''
