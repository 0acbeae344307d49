"""PosedViews -> DepthLikelihoodVolume: the light field's volume, by a plane sweep.

Each label is a plane across the reference camera. A homography says where another view sees its
pixels, in place of the light field's displacement; what is compared there, and how costs become
likelihoods, is the same.
"""

import logging

import cv2
import numpy as np
from numpy.typing import NDArray

from pmcl_ros.dlv.likelihood import row_likelihood, truncate
from pmcl_ros.dlv.pairs import cost_weights
from pmcl_ros.dlv.pixel_grid import PixelGrid
from pmcl_ros.dlv.planes import HALO, matching_planes
from pmcl_ros.dlv.posed_pairs import PosedPairs
from pmcl_ros.dlv.row_costs import aligned_zeros
from pmcl_ros.dlv.sampling import TAPS, bilinear_taps, neutral_taps
from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.dlv.volume import CameraPose, DepthLikelihoodVolume, checked_labels
from pmcl_ros.dlv.window_sums import sum_across, sum_down
from pmcl_ros.geometry.header import Header
from pmcl_ros.lightfield.light_field import LightField
from pmcl_ros.lightfield.posed_view import PosedView, PosedViews
from pmcl_ros.runtime.errors import VolumeError
from pmcl_ros.runtime.kernel_threads import threads
from pmcl_ros.runtime.kernels import compiled, rounds

_LOG = logging.getLogger(__name__)
_CHANNELS = 5  # of `matching_planes`, side by side
_PATCH = 24  # values of 4 pixels side by side, and 4 that follow: whole vectors of 8
_FRACTIONS = 256  # of a pixel that have weights of their own: a place is rounded by 1/512 px
_UNSEEN = np.float32(-1)  # in place of a cost
_ROUNDING = 1e-6  # px: a place so little outside is inside


def build_volume_of_views(views: PosedViews, settings: DlvSettings, reference: int | None = None,
                          level: int = logging.WARNING) -> DepthLikelihoodVolume:
    """The depth likelihood volume of posed views, in the optical frame of one of them.

    reference: number of that view; None: the `central` one. All views are compared with it,
    whatever the settings' `views` says, and count alike. A view that does not see a pixel's point
    at some labels, since it is behind the camera, out of the picture or masked, says nothing
    there: it adds the mean cost of those at which it sees it. Masked pixels of the reference view
    say nothing; their own likelihoods are 0. The header's frame is named after the view;
    `camera` says where it is. level: of the log's line that labels are few.
    Raises VolumeError when there is one view only, the volume would be too large, or the settings
    ask for what only light fields have: interpolation phase, layers joint, back_end gl. Logs a
    warning where no other view sees what the reference view does: all likelihoods are then 0.
    """
    _check(settings)
    pairs = PosedPairs.from_views(views, settings.crop, settings.stride, reference)
    pinhole = pairs.pixels.pinhole
    depths = checked_labels(pairs, settings, pinhole, 'labels', level=level)
    likelihood = _likelihood(pairs, depths, settings)
    if not likelihood.any():
        _LOG.warning('no other view sees what view %d does between %g and %g m: the volume says '
                     'nothing; are poses and depths right, or do masks hide it?', pairs.number,
                     settings.near, settings.far)
    if settings.truncate:
        likelihood = truncate(likelihood, settings.maxima, settings.neighbours)
    frame = views.header.frame_id
    return DepthLikelihoodVolume(
        Header(views.header.stamp_ns, f'{frame}/view_{pairs.number}'), likelihood, depths, pinhole,
        camera=CameraPose(frame, pairs.reference.camera_to_reference))


def _check(settings: DlvSettings) -> None:
    for name, only, other in (('interpolation', 'phase', 'neutral or bilinear'),
                              ('layers', 'joint', 'volume'), ('back_end', 'gl', 'auto')):
        if getattr(settings, name) == only:
            raise VolumeError(f'{name} {only} is for light fields: choose {other} for the volume '
                              'of posed views')


def _likelihood(pairs: PosedPairs, depths: NDArray[np.float64], settings: DlvSettings
                ) -> NDArray[np.float32]:
    """L(x, l), (height, width, labels). Beside it, a band of rows is in memory at a time."""
    neutral = settings.interpolation == 'neutral'
    weights = cost_weights(pairs.gamma, settings.beta).astype(np.float32)
    limits = np.array([settings.tau_color, settings.tau_gradient, settings.tau_gradient])
    fractions = np.linspace(0, 1, _FRACTIONS + 1)
    taps = (neutral_taps if neutral else bilinear_taps)(fractions).astype(np.float32)
    half = settings.window // 2 // settings.stride
    lattice = pairs.pixels.grown(half)
    pairs = pairs.within_reach(lattice, depths, TAPS + HALO)
    sizes = np.array([(each.pinhole.width, each.pinhole.height) for each in pairs.others])
    width, height = sizes.max(axis=0) + 2 * TAPS
    others = np.zeros((len(sizes), height, width, _CHANNELS), np.float32)
    for each, buffer in zip(pairs.others, others, strict=True):
        channels = _channels(each, neutral)
        buffer[:channels.shape[0], :channels.shape[1]] = channels
    rows, columns = pairs.pixels.within(lattice)
    centre = _centre(pairs.reference, lattice, neutral)
    likelihood = np.empty((*pairs.pixels.shape, len(depths)), np.float32)
    single = aligned_zeros(threads(), len(depths) + 1, centre.shape[1] + 2 * half)
    _sweep(centre, (lattice.left, lattice.top), lattice.stride, others, sizes,
           pairs.homographies(depths), taps, weights, limits.astype(np.float32),
           settings.color_cost == 'l2', half, (rows.start, rows.stop),
           (columns.start, columns.stop), single, likelihood)
    if pairs.reference.mask is not None:
        likelihood[~pairs.reference.mask[np.ix_(pairs.pixels.rows, pairs.pixels.columns)]] = 0
    return likelihood


def _centre(reference: PosedView, lattice: PixelGrid, smooth: bool) -> NDArray[np.float32]:
    """(rows, columns, 5) of `matching_planes` at the lattice's pixels."""
    left, top = max(lattice.left - HALO, 0), max(lattice.top - HALO, 0)
    right = min(lattice.left + lattice.width + HALO, reference.pinhole.width)
    bottom = min(lattice.top + lattice.height + HALO, reference.pinhole.height)
    channels = _channels(reference.crop(left, top, right - left, bottom - top), smooth)
    return channels[np.ix_(lattice.rows - top + TAPS, lattice.columns - left + TAPS)]


def _channels(view: PosedView, smooth: bool) -> NDArray[np.float32]:
    """(height + 2 TAPS, width + 2 TAPS, 5) of `matching_planes`: as of a light field of one view.

    NaN where they are made from masked pixels: the cost of what is sampled there is NaN, and no
    cost.
    """
    width, height = view.pinhole.width, view.pinhole.height
    field = LightField.of_one_view(view.header, view.linear(), view.pinhole)
    planes = matching_planes(field, np.empty((0, 2), np.int64), (0, 0, width, height), smooth)[0]
    channels = np.ascontiguousarray(planes[:, :, :width + 2 * TAPS].swapaxes(1, 2))
    if view.mask is not None:
        masked = cv2.dilate((~view.mask).astype(np.uint8), np.ones((2 * HALO + 1,) * 2, np.uint8))
        channels[TAPS:-TAPS, TAPS:-TAPS][masked > 0] = np.nan
    return channels


@compiled(parallel=True)
def _sweep(centre, corner, stride, others, sizes, maps,  # type: ignore[no-untyped-def]
           taps, weights, limits, l2, half, rows, columns, single, likelihood, portion):
    """Fill `likelihood`, a band of rows for each thread, as `cost` does."""
    height, width = centre.shape[:2]
    labels, reach = maps.shape[1], 2 * half + 1
    count, bands = rows[1] - rows[0], len(single)
    flat = others.reshape(len(others), -1)
    for band in rounds(bands, portion):
        first, end = rows[0] + count * band // bands, rows[0] + count * (band + 1) // bands
        across = np.zeros((reach, labels + 1, columns[1] - columns[0]), np.float32)
        summed = np.empty((labels + 1, columns[1] - columns[0]), np.float32)
        costs = np.empty((labels, width), np.float32)
        offsets, jacobians = np.empty(width, np.int64), np.empty((width, 4), np.float32)
        fractions = np.empty((width, 2), np.int64)
        patches = np.empty((width, _PATCH), np.float32)
        for row in range(first - half, end + half):
            sums = across[(row + reach) % reach]
            if 0 <= row < height:
                single[band] = 0
                for pair in range(len(others)):
                    for label in range(labels):
                        _project(corner[0], corner[1] + stride * row, stride, sizes[pair],
                                 others.shape[2], maps[pair, label], offsets, jacobians, fractions)
                        _interpolate_rows(flat[pair], _CHANNELS * others.shape[2], offsets,
                                          fractions, taps, patches)
                        _pixel_costs(centre[row], offsets, jacobians, fractions, taps, patches,
                                     weights[pair], limits, l2, costs[label])
                    _add(costs, half, single[band])
                sum_across(single[band], columns[0], reach, sums)
            else:
                sums[:] = 0
            done = row - half
            if done < first:
                continue
            sum_down(across, row + 1, summed)
            row_likelihood(summed[:labels], summed[labels], likelihood[done - rows[0]])


@compiled(inner=True)
def _add(costs, margin, out):  # type: ignore[no-untyped-def]
    """Add what a pair's costs (labels, width) differ from their mean over the labels it sees.

    out: (labels + 1, margin + width + margin); the last row: the sum of the means.
    """
    zero = np.float32(0)
    mean, seen = np.zeros((2, costs.shape[1]), np.float32)
    for row in costs:
        for x in range(len(row)):  # of a masked pixel it is NaN, which is not >= 0
            mean[x] += row[x] if row[x] >= zero else zero
            seen[x] += np.float32(1) if row[x] >= zero else zero
    last = out[len(costs), margin:]
    for x in range(len(mean)):
        mean[x] = np.divide(mean[x], max(seen[x], np.float32(1)))
        last[x] += mean[x]
    for label in range(len(costs)):
        row, sums = costs[label], out[label, margin:]
        for x in range(len(row)):
            sums[x] += row[x] - mean[x] if row[x] >= zero else zero


@compiled(inner=True)
def _project(left, y, stride, size, view_width, h,  # type: ignore[no-untyped-def]
             offsets, jacobians, fractions):
    """Where a view sees one row of single pixels at one label.

    offsets: (width,) of the first value of the patch there, -1 where it does not see it.
    jacobians: (width, 4) derivatives of its coordinates there by those of the row's pixel: du/dx,
    dv/dx, du/dy, dv/dy. fractions: (width, 2) of a pixel, across and down, in parts of
    `_FRACTIONS`.
    """
    right, bottom = size[0] - 1 + _ROUNDING, size[1] - 1 + _ROUNDING
    for i in range(len(offsets)):
        x = left + stride * i
        w = h[2, 0] * x + h[2, 1] * y + h[2, 2]
        offsets[i] = -1
        if w <= 0:
            continue
        part = np.divide(1.0, w)
        u = (h[0, 0] * x + h[0, 1] * y + h[0, 2]) * part
        v = (h[1, 0] * x + h[1, 1] * y + h[1, 2]) * part
        if not (-_ROUNDING <= u <= right and -_ROUNDING <= v <= bottom):
            continue
        column, row = int(u + 1) - 1, int(v + 1) - 1
        offsets[i] = _CHANNELS * ((row + TAPS - 1) * view_width + column + TAPS - 1)
        fractions[i, 0] = int((u - column) * _FRACTIONS + 0.5)
        fractions[i, 1] = int((v - row) * _FRACTIONS + 0.5)
        jacobians[i, 0] = (h[0, 0] - u * h[2, 0]) * part
        jacobians[i, 1] = (h[1, 0] - v * h[2, 0]) * part
        jacobians[i, 2] = (h[0, 1] - u * h[2, 1]) * part
        jacobians[i, 3] = (h[1, 1] - v * h[2, 1]) * part


@compiled(inner=True)
def _interpolate_rows(view, below, offsets, fractions,  # type: ignore[no-untyped-def]
                      taps, patches):
    """Fill `patches` (width, `_PATCH`): pixels that lie side by side, each read between its rows.

    A loop of its own, over values that lie side by side: the processor adds eight at once.
    """
    for i in range(len(offsets)):
        if offsets[i] < 0:
            continue
        # Unsigned, since of other numbers the compiler looks whether they count from the end.
        first, down = np.uint64(offsets[i]), taps[fractions[i, 1]]
        second = first + np.uint64(below)
        third = second + np.uint64(below)
        fourth = third + np.uint64(below)
        a, b, c, d = down[0], down[1], down[2], down[3]
        out = patches[i]
        for number in range(_PATCH):
            k = np.uint64(number)
            out[k] = (a * view[first + k] + b * view[second + k]
                      + c * view[third + k] + d * view[fourth + k])


@compiled(inner=True)
def _pixel_costs(centre, offsets, jacobians, fractions, taps, patches,  # type: ignore[no-untyped-def]
                 weights, limits, l2, out):
    """Costs of one row of single pixels at one label: of those that the view sees."""
    for i in range(len(out)):
        if offsets[i] < 0:
            out[i] = _UNSEEN
            continue
        across, row, jacobian = taps[fractions[i, 0]], patches[i], jacobians[i]
        a, b, c, d = across[0], across[1], across[2], across[3]
        red = a * row[0] + b * row[5] + c * row[10] + d * row[15] - centre[i, 0]
        green = a * row[1] + b * row[6] + c * row[11] + d * row[16] - centre[i, 1]
        blue = a * row[2] + b * row[7] + c * row[12] + d * row[17] - centre[i, 2]
        along_u = a * row[3] + b * row[8] + c * row[13] + d * row[18]
        along_v = a * row[4] + b * row[9] + c * row[14] + d * row[19]
        # Gradients along the view's axes, as the reference view would see them: by the chain rule.
        along_x = jacobian[0] * along_u + jacobian[1] * along_v
        along_y = jacobian[2] * along_u + jacobian[3] * along_v
        colour = (np.sqrt(red * red + green * green + blue * blue) if l2
                  else abs(red) + abs(green) + abs(blue))
        out[i] = (weights[0] * min(colour, limits[0])
                  + weights[1] * min(abs(along_x - centre[i, 3]), limits[1])
                  + weights[2] * min(abs(along_y - centre[i, 4]), limits[2]))
