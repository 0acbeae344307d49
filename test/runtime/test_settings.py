"""Settings are checked wherever they come from, and errors say where, which and why."""

import os
from pathlib import Path
from typing import Annotated, Literal

import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st
from pydantic import Field, ValidationError, model_validator

from pmcl_ros.camera.sources import CameraSettings
from pmcl_ros.lightfield.calibration.lytro.calibration import Calibration
from pmcl_ros.lightfield.calibration.lytro.lattice import Lattice
from pmcl_ros.lightfield.decode import DecodeSettings
from pmcl_ros.runtime.errors import OutputError, SettingsError
from pmcl_ros.runtime.settings import Settings, read_yaml


class Inner(Settings):
    size: float = Field(gt=0)


class Lengths(Settings):
    near: float = Field(0.3, ge=0.01, le=100, description='depth of the nearest label [m]')
    share: float = Field(0.5, le=1, description='of the pixels [1]')
    sigma: float = Field(0.0, ge=0, description='of the position [mm] and the rotation [deg]')
    sides: tuple[Annotated[float, Field(le=10)], ...] = Field((), description='of a box [m]')
    others: list['Lengths'] = Field([], description='alike')


class Example(Settings):
    count: int = Field(3, ge=1)
    mode: Literal['a', 'b'] = 'a'
    limit: float = 1.0
    name: str = ''
    point: tuple[float, float] = (0.0, 0.0)
    inner: Inner = Inner(size=1)

    @model_validator(mode='after')
    def _together(self):
        if self.mode == 'b' and self.count > 9:
            raise ValueError('mode b counts to 9')
        return self


FINITE = st.floats(allow_nan=False, allow_infinity=False)
EXAMPLES = st.builds(Example, count=st.integers(1), limit=FINITE, name=st.text(),
                     mode=st.just('a'), point=st.tuples(FINITE, FINITE),
                     inner=st.builds(Inner, size=st.floats(1e-300, 1e300)))


@pytest.fixture(scope='module')
def path(tmp_path_factory):
    return tmp_path_factory.mktemp('settings') / 'example.yaml'


@hypothesis_settings(deadline=None)
@given(EXAMPLES, st.text(st.characters(exclude_categories=['C'])))
def test_what_is_saved_is_loaded(path, settings, comment):
    settings.save(path, comment)
    assert Example.load(path) == settings
    assert Example.load(str(path)) == settings


def test_comments_come_first(path):
    Example().save(path, 'one\ntwo')
    assert path.read_text().startswith('# one\n# two\ncount: 3\n')


def test_a_name_that_nobody_could_read_again_is_not_saved(tmp_path):
    class Named(Settings):
        file: Path

    named = Named(file=os.fsdecode(b'a/caf\xe9.obj'))
    with pytest.raises(OutputError, match=r"a.yaml: the name 'a/caf\\udce9'... is no UTF-8"):
        named.save(tmp_path / 'a.yaml')
    assert not (tmp_path / 'a.yaml').exists()


def test_settings_are_frozen():
    with pytest.raises(ValidationError, match='frozen'):
        Example().count = 4


@pytest.mark.parametrize(('values', 'lines'), [
    ({'count': 0}, ['count: Input should be greater than or equal to 1 (got 0)']),
    ({'mode': 'c'}, ["mode: Input should be 'a' or 'b' (got 'c')"]),
    ({'counts': 4}, ['counts: there is no such key; did you mean count?']),
    ({'inner': {'size': 1, 'seize': 1}},
     ['inner.seize: there is no such key; did you mean size?']),
    ({'inner': {'size': 1, 'count': 1}},
     ['inner.count: there is no such key', 'the keys are size']),
    ({'nonsense': 4}, ['nonsense: there is no such key',
                       'the keys are count, mode, limit, name, point, inner']),
    ({'limit': float('inf')}, ['limit: Input should be a finite number (got inf)']),
    ({'point': [1.0]}, ['point: number 2 is missing (got [1.0])']),
    ({'inner': {'size': -1}}, ['inner.size: Input should be greater than 0 (got -1)']),
    ({'inner': {}}, ['inner.size: Field required']),
    ({'mode': 'b', 'count': 10},
     ['mode b counts to 9']),
    ({1: 2}, ['1: Keys should be strings (got 1)']),
    ({'count': 0, 'limit': 'x'},
     ['count: Input should be greater than or equal to 1 (got 0)',
      "limit: Input should be a valid number, unable to parse string as a number (got 'x')"]),
])
def test_errors_name_source_field_and_value(values, lines):
    with pytest.raises(SettingsError) as caught:
        Example.make(values, 'the source')
    assert str(caught.value) == 'the source: ' + '; '.join(lines)


@pytest.mark.parametrize(('values', 'line'), [
    ({'near': 300}, 'near: Input should be less than or equal to 100 m (got 300)'),
    ({'sides': [1, 160]}, 'sides.1: Input should be less than or equal to 10 m (got 160)'),
    ({'others': [{}, {'near': 0}]},
     'others.1.near: Input should be greater than or equal to 0.01 m (got 0)'),
    ({'share': 50}, 'share: Input should be less than or equal to 1 (got 50)'),
    ({'sigma': -1}, 'sigma: Input should be greater than or equal to 0 (got -1)')])
def test_a_limit_has_its_unit(values, line):
    with pytest.raises(SettingsError) as caught:
        Lengths.make(values, 'the source')
    assert str(caught.value) == f'the source: {line}'


def test_an_error_in_a_file_names_the_file(path):
    path.write_text('count: 0')
    with pytest.raises(SettingsError, match=r'example.yaml: count: .*got 0'):
        Example.load(path)


def test_a_value_that_unfolds_to_gigabytes_is_not_shown_whole(path):
    lines = ['a0: &a0 [x, x, x, x, x, x, x, x, x]']
    lines += [f'a{n}: &a{n} [{", ".join([f"*a{n - 1}"] * 9)}]' for n in range(1, 12)]
    path.write_text('\n'.join([*lines, 'count: *a11']))
    with pytest.raises(SettingsError, match=r'values or 64 levels at line 6 \(aliases followed'):
        Example.load(path)


def test_merge_keys_can_nest_without_end(path):
    lines = ['a0: &a0 {x: 1}']
    lines += [f'a{n}: &a{n}\n  <<: [{", ".join([f"*a{n - 1}"] * 9)}]' for n in range(1, 12)]
    path.write_text('\n'.join(lines))
    with pytest.raises(SettingsError, match=r'values or 64 levels at line 1\d \(aliases'):
        Example.load(path)


def test_aliases_and_merge_keys_of_some_values_are_followed(path):
    path.write_text('one: &one {a: 1, b: 2}\ntwo: {<<: *one, b: 3}\nagain: *one')
    assert read_yaml(path) == {'one': {'a': 1, 'b': 2}, 'two': {'a': 1, 'b': 3},
                               'again': {'a': 1, 'b': 2}}


def test_a_message_names_few_of_many_faults(path):
    path.write_text('\n'.join(f'k{k}: 1' for k in range(49_000)))
    with pytest.raises(SettingsError, match=r'and 48995 more; the keys are count') as caught:
        Example.load(path)
    assert len(str(caught.value)) < 1000


def test_a_message_is_one_line_that_a_terminal_can_show():
    text = str(SettingsError('a\nb\x1b[31m \ud800 \u00e4 ' + 5000 * 'x'))
    assert text.startswith('a b\\x1b[31m \\ud800 \u00e4 xxx')
    assert len(text) < 2100
    assert text.isprintable()


@pytest.mark.parametrize(('content', 'reason'), [
    (b'', 'holds NoneType, expected a mapping'),
    (b'- 1', 'holds list, expected a mapping'),
    (b'text', 'holds str, expected a mapping'),
    (b'a: [', 'is not valid YAML in line 2, column 1: while parsing a flow node, did not'),
    (b'a: \xe4', 'is no text in UTF-8: byte 3 is 0xe4'),
    (b'size: 1\ncount: 2\nsize: 3',
     "is not valid YAML in line 3, column 1: 'size' is there more than once$"),
    (b'a: [{b: 1, b: 2}]', "is not valid YAML in line 1, column 12: 'b' is there more than once$"),
    (b'a: 2026-99-99', 'is not valid YAML: month'),
    (b'a: !!python/name:os.system', 'is not valid YAML'),
    (b'[' * 500, 'has more than 100000 values or 64 levels at line 1'),
    # libyaml has a limit of its own from 0.2.6 on, and reads ahead
    (b'[' * 100_000, '100000 values or 64 levels at line 1|exceeded maximum nesting depth'),
    (b'a: ' + b':'.join([b'1'] * 3000), 'has a number of 5999 characters in line 1'),
    (b'\n'.join(b'k%d: 1' % k for k in range(300_000)), 'has more than 100000 values'),
    (b' ' * 2 ** 22 + b' ', 'has more than 4 MiB'),
])
def test_what_is_no_mapping_is_refused(path, content, reason):
    path.write_bytes(content)
    with pytest.raises(SettingsError, match=f'example.yaml {reason}'):
        read_yaml(path)


def test_files_that_cannot_be_read_or_written(tmp_path):
    with pytest.raises(SettingsError, match=r'cannot read .*none.yaml: No such file'):
        read_yaml(tmp_path / 'none.yaml')
    with pytest.raises(SettingsError, match=r'cannot read .*: Is a directory'):
        read_yaml(tmp_path)
    Example().save(tmp_path / 'made' / 'none.yaml')
    with pytest.raises(OutputError, match=r'cannot write .*none.yaml: .* is no folder'):
        Example().save(tmp_path / 'made' / 'none.yaml' / 'none.yaml')


@pytest.mark.parametrize('kind', [CameraSettings, DecodeSettings, Calibration, Lattice])
def test_every_number_and_path_is_described_with_its_unit(kind):
    for name, field in kind.model_fields.items():
        if field.annotation is not Lattice:
            assert field.description, name
        if field.annotation is float:
            assert field.description.endswith(']') or '[s]' in field.description, name
