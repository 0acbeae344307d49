"""Which frames of a sweep are used: those of which nothing speaks against, one for each cell."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.lightfield.sweep.frame import LeftOut, SweepFrame
from pmcl_ros.lightfield.sweep.layout import Layout
from pmcl_ros.lightfield.sweep.settings import SweepSettings

Sorted = tuple[list[SweepFrame], list[LeftOut]]


def good_pictures(frames: Sequence[SweepFrame], settings: SweepSettings) -> Sorted:
    """Without those that moved while they were exposed, are blurred, or darker or brighter.

    Blur and brightness are measured against the median of those that did not move: a scene of
    little texture is no blurred one.
    """
    left: list[LeftOut] = []
    still: list[SweepFrame] = []
    for each in frames:
        reason = moves(each, settings)
        if reason:
            left.append(LeftOut(each.name, reason))
        else:
            still.append(each)
    if not still:
        return still, left
    light = np.array([each.brightness for each in still])
    usual = float(np.median(light))
    shares = relative_sharpness(still)
    good: list[SweepFrame] = []
    for each, share, mean in zip(still, shares, light, strict=True):
        if share < settings.sharpness:
            left.append(LeftOut(each.name, f'blurred: {100 * share:.0f} % of the usual sharpness, '
                                f'{100 * settings.sharpness:.0f} are needed'))
        elif abs(mean - usual) > settings.brightness * usual:
            left.append(LeftOut(each.name, f'its mean is {mean:.3f}, that of most {usual:.3f}: '
                                'lock exposure and white balance'))
        else:
            good.append(each)
    return good, left


def moves(frame: SweepFrame, settings: SweepSettings) -> str:
    """Why a frame moved too much while it was exposed; empty where it did not."""
    moved = frame.movement(settings.near, settings.exposure)
    if moved <= settings.movement:
        return ''
    return (f'moved by {moved:.1f} px in its {1e3 * settings.exposure:g} ms ({frame.speed:.3f} '
            f'm/s, {frame.turning:.3f} rad/s), {settings.movement:g} are allowed')


def relative_sharpness(frames: Sequence[SweepFrame]) -> NDArray[np.float64]:
    """(n,) the less sharp direction of each frame, relative to the median of all."""
    energies = np.array([each.sharpness for each in frames])
    return np.asarray((energies / np.maximum(np.median(energies, axis=0), 1e-12)).min(axis=1))


def one_for_each_cell(frames: Sequence[SweepFrame], layout: Layout,
                      reference: int) -> tuple[dict[tuple[int, int], SweepFrame], list[LeftOut]]:
    """The frame of each cell (row, column), and the others.

    Of several the sharper one and that nearer to the cell's middle is better. The centre cell has
    the reference, the frame of that number, wherever it is.
    """
    rows, columns = layout.shape
    score = np.minimum(relative_sharpness(frames), 1.0) - layout.aside
    chosen: dict[tuple[int, int], int] = {(rows // 2, columns // 2): reference}
    left: list[LeftOut] = []
    for number in np.argsort(-score, kind='stable').tolist():
        if number == reference:
            continue
        row, column = layout.cells[number].tolist()
        if not layout.inside[number]:
            left.append(LeftOut(frames[number].name, f'outside the {rows}x{columns} grid, at row '
                                f'{row}, column {column}'))
        elif (row, column) in chosen:
            left.append(LeftOut(frames[number].name, f'{frames[chosen[row, column]].name} is '
                                f'better or nearer in row {row}, column {column}', True))
        else:
            chosen[row, column] = number
    return {cell: frames[number] for cell, number in chosen.items()}, left
