"""A Lambertian scene in the layout of the 4D Light Field Benchmark, by the benchmark's measure."""

import cv2
import numpy as np
from dlv_fields import Texture

from pmcl_ros.dlv.build import build_volume
from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.lightfield.readers.read import read_light_field

SIDE, VIEWS = 96, 9
FOCAL, SENSOR, BASELINE, FOCUS = 100.0, 35.0, 0.05, 8.0  # mm, mm, m, m
SCALE = FOCAL / SENSOR * SIDE * BASELINE  # px per view step, times m
RADIUS, BEFORE = 18, 0.7  # px: of a disc; px per view step: before the wall's middle
SLOPE = np.array([0.004, -0.003])  # px per view step and px: how the wall is slanted
WALL = -0.4  # px per view step: the wall's disparity in its middle


def scene(folder):
    """Writes a slanted wall and a disc before it; returns the disparity of the centre view, and
    how far each pixel is from the disc's outline [px].
    """
    y, x = np.mgrid[:SIDE, :SIDE] - (SIDE - 1) / 2
    wall, disc = Texture(1, 0.2, 16), Texture(2, 0.2, 16)
    for number, (row, column) in enumerate(np.ndindex(VIEWS, VIEWS)):
        a, b = column - VIEWS // 2, row - VIEWS // 2
        # A view shows at u what the centre view has at x = u + (a, b) disparity(x).
        place = np.stack([x + a * WALL, y + b * WALL], axis=-1)
        u, v = np.moveaxis(place @ np.linalg.inv(np.eye(2) - np.outer([a, b], SLOPE)).T, -1, 0)
        s, t = (each + step * (WALL + BEFORE) for each, step in ((x, a), (y, b)))
        hit = np.clip(RADIUS + 0.5 - np.hypot(s, t), 0, 1)[..., None]
        picture = hit * disc(s, t) + (1 - hit) * wall(u, v)
        cv2.imwrite(str(folder / f'input_Cam{number:03d}.png'),
                    np.rint(255 * picture[..., ::-1]).astype(np.uint8))
    (folder / 'parameters.cfg').write_text(
        f'[intrinsics]\nfocal_length_mm = {FOCAL}\nimage_resolution_x_px = {SIDE}\n'
        f'image_resolution_y_px = {SIDE}\nsensor_size_mm = {SENSOR}\n[extrinsics]\n'
        f'num_cams_x = {VIEWS}\nnum_cams_y = {VIEWS}\nbaseline_mm = {1000 * BASELINE}\n'
        f'focus_distance_m = {FOCUS}\n')
    distance = np.hypot(x, y) - RADIUS
    slanted = WALL + SLOPE[0] * x + SLOPE[1] * y
    return np.where(distance < 0, WALL + BEFORE, slanted), np.abs(distance)


def test_bad_pixels(tmp_path):
    truth, distance = scene(tmp_path)
    volume = build_volume(read_light_field(tmp_path), DlvSettings(
        near=5.5, far=14, views=VIEWS, edge_labels=2))
    disparity = SCALE * (1 / volume.depth_map() - 1 / FOCUS)
    # A view sees the disc displaced by up to 4 * 0.7 px more than the wall; the window has 2 px.
    judged = distance > 6
    border = 10  # px: views are displaced by up to 4 * 0.9 px, and that of the reader by more
    judged[:border] = judged[-border:] = judged[:, :border] = judged[:, -border:] = False
    assert judged.mean() > 0.4
    assert (judged & (truth == WALL + BEFORE)).sum() > 300  # some of the disc
    bad = ~(np.abs(disparity - truth) <= 0.07)
    assert bad[judged].mean() < 0.15
