"""Contour maps in which one object is seen, without any picture."""

import numpy as np
from pmcl_scenes import near_pixels
from scipy.ndimage import distance_transform_edt

from pmcl_ros.dlv.volume import depth_labels
from pmcl_ros.evidence.contour_map import ContourMap
from pmcl_ros.evidence.learned import LearnedMapEvidence
from pmcl_ros.geometry.header import Header

NUMBERS = LearnedMapEvidence(contour_weight=0.3, inside_weight=0.02, least_evidence=0.0,
                             least_support=-1.0, least_weight=0.0, common_error=0.1,
                             local_error=0.2, error_length=40.0)


def map_seen(mask, pinhole, near, far, zoom=4):
    """Log odds of the outline of a mask (zoom * height, zoom * width), and of its inside."""
    around, kept = near_pixels(mask, zoom)
    shape = tuple(each // zoom for each in mask.shape)
    on, nx, ny = (np.zeros(shape) for _ in range(3))
    if mask.any():
        on[kept], nx[kept], ny[kept] = _outline(mask[around], zoom)
    tensor = np.stack([on - 4, 5 * on * nx, 5 * on * ny, 2 * on * (nx ** 2 - ny ** 2),
                       4 * on * nx * ny], axis=-1).astype(np.float32)
    middle = slice(zoom // 2, None, zoom)
    inside = np.where(mask[middle, middle], 1.0, -2.0).astype(np.float32)
    return ContourMap(Header(stamp_ns=5), tensor[:, :, None], depth_labels(near, far, 2), pinhole,
                      inside[:, :, None], NUMBERS)


def _outline(mask, zoom):
    """How near the outline of a mask is, and its outward normal (x, y), for each pixel."""
    out, (row, column) = distance_transform_edt(~mask, return_indices=True)
    into, (row_in, column_in) = distance_transform_edt(mask, return_indices=True)
    y, x = np.indices(mask.shape)
    # Outside, from the nearest pixel of the mask; inside, towards the nearest pixel out of it.
    outward = np.where(mask[..., None], np.stack([column_in - x, row_in - y], axis=-1),
                       np.stack([x - column, y - row], axis=-1)).astype(float)
    middle = slice(zoom // 2, None, zoom)
    n = outward[middle, middle]
    n /= np.maximum(np.linalg.norm(n, axis=-1, keepdims=True), 1e-9)
    away = np.maximum(out, into)[middle, middle] / zoom
    return np.exp(-0.5 * away ** 2), n[..., 0], n[..., 1]
