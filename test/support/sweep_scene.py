"""Pictures of a made-up scene from cameras anywhere, with any lens, by a ray for each pixel."""

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.light_field import nominal_positions
from pmcl_ros.lightfield.readers.sweep_folder import NAME, SweepFolder
from pmcl_ros.lightfield.sweep.frame import Lens, SweepFrame

PINHOLE = Pinhole(160, 120, 200.0, 202.0, 80.5, 58.0)
STAMP = 1_700_000_000_000_000_000
WALL, DISC, RADIUS = 0.9, 0.5, 0.07  # m
GAMMA = 2.2


def pose_at(x=0.0, y=0.0, z=0.0, turn=(0.0, 0.0, 0.0)):
    """turn: rotation vector [degrees]."""
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_rotvec(turn, degrees=True).as_matrix()
    pose[:3, 3] = x, y, z
    return pose


def light(lens, pose):
    """(height, width, 3) linear light that a camera at `pose` (4, 4) sees."""
    pinhole = lens.pinhole
    pixels = np.stack(np.meshgrid(np.arange(pinhole.width), np.arange(pinhole.height)), axis=-1)
    points = pixels.reshape(-1, 1, 2).astype(float)
    distortion = np.array(lens.distortion)
    if lens.model == 'equidistant' and lens.distortion:
        flat = cv2.fisheye.undistortPoints(points, pinhole.matrix, distortion)
    else:
        flat = cv2.undistortPointsIter(points, pinhole.matrix, distortion, np.eye(3), np.eye(3),
                                       (cv2.TERM_CRITERIA_COUNT, 60, 0)) if hasattr(
            cv2, 'undistortPointsIter') else cv2.undistortPoints(
            points, pinhole.matrix, distortion,
            criteria=(cv2.TERM_CRITERIA_COUNT, 60, 0))
    ways = np.concatenate([flat[:, 0], np.ones((len(points), 1))], axis=1) @ pose[:3, :3].T

    def at(depth):
        x, y, z = pose[:3, 3]
        far = (depth - z) / ways[:, 2]
        return x + far * ways[:, 0], y + far * ways[:, 1]

    disc = at(DISC)
    # Its edge is soft, a few pixels wide, as a lens leaves it.
    hit = 0.5 + 0.5 * np.tanh((RADIUS - np.hypot(*disc)) / (0.01 * DISC))
    wall, near = pattern(*at(WALL), 0), pattern(*disc, 2)
    return (wall + hit[:, None] * (near - wall)).reshape(pinhole.height, pinhole.width, 3)


def pattern(x, y, kind):
    """RGB in [0.1, 0.9] at places x, y [m], up to about 0.1 cycles per px."""
    waves = [(93, 41, kind), (97, -37, 2 * kind), (61, 73, -kind), (29, 17, 1 + kind),
             (-23, 31, kind - 1)]
    total = [np.sin(a * x + b * y + c) for a, b, c in waves]
    return np.stack([0.5 + 0.13 * (total[0] + total[1] + total[2]),
                     0.5 + 0.13 * (total[1] + total[3] + total[4]),
                     0.5 + 0.13 * (total[0] + total[2] + total[4])], axis=-1)


def frame(name, pose, lens=None, number=0, kind=np.uint16, **changes):
    """A frame as a camera of gamma 2.2 gives it."""
    lens = lens or Lens(PINHOLE)
    encoded = light(lens, pose) ** (1 / GAMMA)
    white = np.iinfo(kind).max
    return SweepFrame(name, STAMP + number * 100_000_000, np.rint(white * encoded).astype(kind),
                      lens, pose, **changes)


def raster(rows, columns, step, jitter=0.0, degrees=0.0, seed=0, base=None):
    """Poses of a grid about `base`, off by normal deviates [m, degrees] except the centre's."""
    rng = np.random.default_rng(seed)
    base = np.eye(4) if base is None else base
    poses = []
    for row, column in np.ndindex(rows, columns):
        x, y = step * nominal_positions(rows, columns)[row, column]
        off, turn = rng.normal(0, 1, 3), rng.normal(0, 1, 3)
        if (row, column) == (rows // 2, columns // 2):
            off, turn = 0 * off, 0 * turn
        poses.append(base @ pose_at(*((x, y, 0) + jitter * off * [1, 1, 0.1]), degrees * turn))
    return poses


def write_sweep(folder, frames, settings):
    """Write pictures and sweep.yaml, the inverse of `read_sweep`; all frames share one lens."""
    folder.mkdir(parents=True, exist_ok=True)
    lens, entries = frames[0].lens, []
    for each in frames:
        name = f'{each.name}.png'
        assert cv2.imwrite(str(folder / name), np.ascontiguousarray(each.image[..., ::-1]))
        orientation = Rotation.from_matrix(each.pose[:3, :3]).as_quat(canonical=True).tolist()
        entries.append({'file': name, 'position': each.position.tolist(),
                        'orientation': orientation})
    pinhole = lens.pinhole
    camera = {'fx': pinhole.fx, 'fy': pinhole.fy, 'cx': pinhole.cx, 'cy': pinhole.cy,
              'model': lens.model, 'distortion': lens.distortion}
    SweepFolder.make(settings.model_dump() | {'camera': camera, 'frames': entries},
                     NAME).save(folder / NAME)
