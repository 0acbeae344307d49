"""The evidence of views that come again."""

from dataclasses import replace

import numpy as np

from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.evidence.build_views import ViewsEvidenceBuilder
from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.posed_view import PosedView, PosedViews


def view(seed: int) -> PosedView:
    picture = np.random.default_rng(seed).random((48, 64, 3), np.float32)
    picture[:4] = 1  # as overexposed
    return PosedView(Header(frame_id='base'), picture, Pinhole(64, 48, 60.0, 60.0, 31.5, 23.5),
                     np.eye(4))


def test_a_picture_is_known_by_its_pixels_and_its_camera() -> None:
    builder = ViewsEvidenceBuilder(DlvSettings(), contour_maps=False)
    one, other = view(1), view(2)
    first = builder.build(PosedViews((one, other, one))).views
    assert first[0].evidence is first[2].evidence is not first[1].evidence
    moved = np.eye(4)
    moved[0, 3] = 0.1
    again = replace(one, picture=one.picture.copy(), camera_to_reference=moved,
                    sigma=(0.001, 0.002), group='arm', common=0.4, drift=0.003)
    second = builder.build(PosedViews((again, other))).views
    assert second[0].evidence is first[0].evidence
    assert second[1].evidence is first[1].evidence
    for name in ('camera_to_reference', 'sigma', 'group', 'common', 'drift'):
        assert getattr(second[0], name) is getattr(again, name), name
    assert second[0].view is again
    changed = other.picture.copy()
    changed[37, 41] = 0
    wide = replace(one.pinhole, fx=61.0)
    third = builder.build(PosedViews((replace(other, picture=changed),
                                      replace(one, pinhole=wide)))).views
    assert not {id(each.evidence) for each in third} & {id(each.evidence) for each in first}
    mask = np.ones((48, 64), bool)
    maps = ViewsEvidenceBuilder(DlvSettings())
    plain = maps.build(PosedViews((one,))).views[0].evidence
    mask[20:, 10:20] = False
    masked = maps.build(PosedViews((replace(one, mask=mask),))).views[0].evidence
    assert masked is not plain
    again = maps.build(PosedViews((replace(one, mask=mask.copy()),)))
    assert again.views[0].evidence is masked
    # Only the last views are kept.
    assert builder.build(PosedViews((one,))).views[0].evidence is not first[0].evidence
