"""Capture with truth -> the example that is searched in it."""

from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.dlv.volume import depth_labels
from pmcl_ros.evaluation.captures import Capture
from pmcl_ros.evidence.build_map import build_map
from pmcl_ros.evidence.edges import edge_volume
from pmcl_ros.evidence.learned import LearnedMapEvidence
from pmcl_ros.evidence.posed_evidence import ViewsEvidence
from pmcl_ros.learning.contour_tables import Example
from pmcl_ros.learning.posed_views import ViewsExample
from pmcl_ros.lightfield.posed_view import PosedViews
from pmcl_ros.pipeline import apparent_size, build_evidence
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.prior.region import Region
from pmcl_ros.pmcl.settings import PmclSettings
from pmcl_ros.runtime.errors import SettingsError

_LARGEST = 0.14  # m: radius of any generated object


def example_of_edges(capture: Capture, views: int) -> Example:
    """By the edges of a light field. views: side of the square of views that are used."""
    truth = capture.truth
    region = Region(truth.roi_center, truth.roi_size)
    labels = depth_labels(*region.grown(_LARGEST), DlvSettings().edge_labels)
    return Example(edge_volume(capture.light_field(), labels, views),
                   ObjectModel.load(capture.model), truth.pose, region, not truth.empty)


def example_of_map(capture: Capture, views: int, numbers: LearnedMapEvidence) -> Example:
    """By the contour map of a light field or one picture.

    views: as for edges. Raises SettingsError for several views.
    """
    truth, source = capture.truth, capture.read(None)
    if isinstance(source, PosedViews):
        raise has_several(capture)
    region = Region(truth.roi_center, truth.roi_size)
    near, far = region.grown(_LARGEST)
    settings = DlvSettings.make({'near': near, 'far': far, 'views': views}, str(capture.folder))
    return Example(build_map(source, settings, numbers=numbers), ObjectModel.load(capture.model),
                   truth.pose, region, not truth.empty)


def example_of_views(capture: Capture) -> ViewsExample:
    """By the contour maps of several views. Raises SettingsError for another capture."""
    truth, source = capture.truth, capture.read(None)
    if not isinstance(source, PosedViews):
        raise SettingsError(f'{capture.folder} has no several views; render them with pmcl '
                            'scenes render --cameras')
    model = ObjectModel.load(capture.model)
    settings = PmclSettings(roi_center=truth.roi_center, roi_size=truth.roi_size)
    evidence = build_evidence(source, DlvSettings(), 'default', 'map',
                              apparent_size(model, settings))
    assert isinstance(evidence, ViewsEvidence)
    return ViewsExample(evidence, model, truth.pose, settings, not truth.empty)


def has_several(capture: Capture) -> SettingsError:
    """The error for a capture of several views, where one light field or picture is needed."""
    return SettingsError(f'{capture.folder} has several views; learn from them with --posed')
