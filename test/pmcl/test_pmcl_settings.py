import pytest

from pmcl_ros.pmcl.prior.region import Region
from pmcl_ros.pmcl.settings import PmclSettings
from pmcl_ros.runtime.errors import SettingsError


def test_defaults_are_valid_and_described():
    fields = PmclSettings.model_fields
    assert all(field.description for field in fields.values())
    settings = PmclSettings()
    assert Region(settings.roi_center, settings.roi_size).near == pytest.approx(0.47)
    # The paper's numbers.
    assert (settings.faithful_particles, settings.faithful_iterations) == (100, 500)


@pytest.mark.parametrize(('values', 'message'), [
    ({'mode': 'best'}, "mode: .*'default' or 'faithful'"),
    ({'roi_size': [0.1, 0, 0.1]}, r'roi_size\.1: .*greater than 0'),
    ({'roi_center': [0, 0]}, 'roi_center: number 3 is missing'),
    ({'roi_center': [0, 0, float('inf')]}, r'roi_center\.2: .*finite'),
    ({'particles': 1}, 'particles: .*greater than or equal to 2'),
    ({'seed': -1}, 'seed: .*greater than or equal to 0'),
    ({'faithful_threshold': 0}, 'faithful_threshold: .*greater than 0'),
    ({'particels': 100}, 'particels'),
])
def test_impossible_values_are_refused_by_name(values, message):
    with pytest.raises(SettingsError, match=message):
        PmclSettings.make(values)
