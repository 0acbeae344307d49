import pytest

from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.runtime.errors import SettingsError


def test_defaults_are_valid_and_described():
    fields = DlvSettings.model_fields
    assert DlvSettings().labels == 75
    assert all(field.description for field in fields.values())


@pytest.mark.parametrize(('values', 'message'), [
    ({'near': 0.9, 'far': 0.3}, r'near 0\.9 m must be smaller than far 0\.3 m'),
    ({'views': 4}, 'views: .*must be odd'),
    ({'window': 2}, 'window: .*must be odd'),
    ({'beta': 1.5}, 'beta: .*less than or equal to 1'),
    ({'color_cost': 'l3'}, "color_cost: .*'l2' or 'sad'"),
    ({'interpolation': 'cubic'}, "interpolation: .*'neutral', 'phase' or 'bilinear'"),
    ({'crop': (-1, 0, 0, 0)}, 'crop.*greater than or equal to 0'),
    ({'stride': 0}, 'stride: .*greater than or equal to 1'),
    ({'lables': 75}, 'lables'),
])
def test_impossible_values_are_refused_by_name(values, message):
    with pytest.raises(SettingsError, match=message):
        DlvSettings.make(values)
