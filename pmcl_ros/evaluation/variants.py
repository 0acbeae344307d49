"""The rows of a comparison: each a way to make the evidence and to search in it."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

from pmcl_ros.dlv.pixel_grid import PixelGrid
from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.dlv.volume import depth_labels
from pmcl_ros.evaluation.ablations import ablated
from pmcl_ros.evaluation.captures import Capture
from pmcl_ros.evidence.contour_map import ContourMap
from pmcl_ros.evidence.edges import edge_volume
from pmcl_ros.evidence.posed_evidence import ViewsEvidence
from pmcl_ros.lightfield.light_field import LightField
from pmcl_ros.lightfield.posed_view import PosedViews, centre_view
from pmcl_ros.lightfield.readers.read import Source
from pmcl_ros.pipeline import (
    Evidence,
    apparent_size,
    binned_to_draw,
    build_evidence,
    depths_of,
    evidence_kind,
    volume_settings,
)
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.settings import EvidenceKind, Mode, PmclSettings
from pmcl_ros.runtime.errors import FileError, SettingsError
from pmcl_ros.runtime.text_file import parse_yaml

Base = Literal['default', 'faithful', 'centre', 'edges', 'map', 'map-centre', 'map-no-sides',
               'map-no-directions', 'map-one-depth', 'map-inside']

_OF_THE_CAPTURE = ('near', 'far', 'object', 'roi_center', 'roi_size', 'seed', 'mode')

# Of a row; rows that are not here have the map. auto: the row leaves it open.
_EVIDENCE: dict[Base, EvidenceKind] = {
    'default': 'auto', 'faithful': 'auto', 'centre': 'edges', 'edges': 'edges'}


@dataclass(frozen=True)
class Variant:
    """One row of a comparison.

    name: as shown. base: the row that this one changes; 'centre' and 'map-centre' use the
        centre view alone, 'edges' and 'map' ones that evidence, other 'map-' ones a part of it
        (`ABLATIONS`).
    dlv, pmcl: changed parameters, (name, value) pairs. group: the parameter that a sweep varies,
    for its chart of accuracy over time; empty outside sweeps.
    """

    name: str
    base: Base = 'default'
    dlv: tuple[tuple[str, Any], ...] = ()
    pmcl: tuple[tuple[str, Any], ...] = ()
    group: str = ''

    @classmethod
    def named(cls, name: str) -> 'Variant':
        """The row of a name in `Base`; SettingsError for another name."""
        if name not in get_args(Base):
            raise SettingsError(f'there is no row {name!r}, only {", ".join(get_args(Base))}')
        return cls(name, {each: each for each in get_args(Base)}[name])

    @classmethod
    def parse(cls, text: str, group: str = '') -> 'Variant':
        """A row of `KEY=VALUE,...`: parameters of the volume or of the search, values as in YAML.

        `row=faithful` starts from that row. Raises SettingsError for an unknown parameter.
        """
        try:
            values = parse_yaml('{' + text.replace('=', ': ') + '}', text)
        except FileError:
            values = None
        if not isinstance(values, dict) or not values or None in values.values():
            raise SettingsError(f'{text!r} is not of the form KEY=VALUE,KEY=VALUE')
        base = cls.named(str(values.pop('row', 'default'))).base
        dlv, pmcl = (_of(settings, values) for settings in (DlvSettings, PmclSettings))
        unknown = [key for key in values if key not in dlv | pmcl]
        if unknown:
            raise SettingsError(f'{text!r}: {", ".join(map(str, unknown))} is no parameter of the '
                                'volume or the search, or one that the capture decides')
        wanted, of_row = pmcl.get('evidence', 'auto'), _EVIDENCE.get(base, 'map')
        if 'auto' not in (wanted, of_row) and wanted != of_row:
            raise SettingsError(f'{text!r}: row={base} has evidence {of_row}, not {wanted}: leave '
                                'one of them out')
        DlvSettings.make(dlv, text)
        PmclSettings.make(pmcl, text)
        return cls(text, base, tuple(dlv.items()), tuple(pmcl.items()), group)

    @property
    def mode(self) -> Mode:
        """The mode of the search."""
        return 'faithful' if self.base == 'faithful' else 'default'

    @property
    def chosen(self) -> dict[str, EvidenceKind]:
        """The evidence of the mode default, where the row does not leave it to the source."""
        if self.base.startswith('map'):
            return {'evidence': 'map'}
        if self.base == 'edges':
            return {'evidence': 'edges'}
        return {name: value for name, value in self.pmcl if name == 'evidence'}

    def search(self, capture: Capture) -> PmclSettings:
        """The search's settings for a capture. Raises SettingsError for impossible values."""
        return PmclSettings.make({'mode': self.mode, 'roi_center': capture.truth.roi_center,
                                  'roi_size': capture.truth.roi_size} | dict(self.pmcl)
                                 | self.chosen, self.name)

    def volume(self, capture: Capture, model: ObjectModel, source: Source) -> DlvSettings:
        """The settings of the evidence, to look for a model's object in a capture's source."""
        near, far = depths_of(capture.truth.roi_center, capture.truth.roi_size, model.radius,
                              isinstance(source, PosedViews))
        grid = source.grid if isinstance(source, LightField) else None
        return volume_settings(self.mode, near, far, grid, dict(self.dlv), self.name)

    def build(self, source: Source, settings: DlvSettings, capture: Capture, model: ObjectModel
              ) -> Evidence:
        """The evidence that the row's search reads; of the centre view alone, labels are equal."""
        if self.base == 'map-centre' and isinstance(source, LightField):
            source = centre_view(source)
        if self.base != 'centre' or not isinstance(source, LightField):
            search = self.search(capture)
            source = binned_to_draw(source, settings, search, model.radius)
            made = build_evidence(source, settings, self.mode,
                                  evidence_kind(PmclSettings(**self.chosen), source),
                                  apparent_size(model, search))
            return _ablated(made, self.base)
        depths = depth_labels(settings.near, settings.far, settings.edge_labels)
        return edge_volume(source, depths, views=1).on(
            PixelGrid.from_crop(source.grid.pinhole, settings.crop, settings.stride))


def _ablated(made: Evidence, base: Base) -> Evidence:
    """Evidence as a row wants it; of several views, that of each."""
    if isinstance(made, ViewsEvidence):
        return replace(made, views=tuple(
            replace(each, evidence=ablated(each.evidence, base))
            if isinstance(each.evidence, ContourMap) else each for each in made.views))
    return ablated(made, base) if isinstance(made, ContourMap) else made


def _of(settings: type[DlvSettings] | type[PmclSettings], values: Mapping[str, Any]
        ) -> dict[str, Any]:
    return {key: tuple(value) if isinstance(value, list) else value
            for key, value in values.items()
            if key in settings.model_fields and key not in _OF_THE_CAPTURE}


def sweep(text: str) -> list[Variant]:
    """The rows of `KEY=VALUE,VALUE,...`, one for each value."""
    key, _, values = text.partition('=')
    if not values:
        raise SettingsError(f'{text!r} is not of the form KEY=VALUE,VALUE')
    return [Variant.parse(f'{key}={value}', key) for value in values.split(',')]
