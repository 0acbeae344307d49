"""Draws the frames of the chain, seen from the camera's right."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.grasps.settings import GraspSettings
from pmcl_ros.pmcl.settings import PmclSettings

_X, _Y, _Z = '#d62728', '#2ca02c', '#1f4fd8'  # as viewers colour them
_GLASS, _GREY = '#5aa7d6', '#777777'
_ARM = 0.036  # m: of a drawn axis
_BESIDE = 0.014  # m: of an axis' letter from its tip
_TILT = np.deg2rad(8)  # of the object that is drawn
_WRIST_TO_FINGERS = 0.166  # m: `parent_to_grasp` of the default gripper
_OUTLINE = np.array([[0.034, -0.075], [0.03, -0.07], [0.004, -0.065], [0.004, 0.0],
                     [0.025, 0.02], [0.034, 0.045], [0.03, 0.075]])  # m: half of a wine glass


def frames_figure() -> Figure:
    """Camera, region of interest and object, with the defaults of the parameters."""
    search, volume, grasps = PmclSettings(), DlvSettings(), GraspSettings()
    drawn = Figure((8.6, 3.2), 100, layout='constrained')
    axes = drawn.subplots()
    _planes(axes, volume.near, volume.far)
    _region(axes, search)
    _object(axes, search)
    wrist = np.array([0, -grasps.mount_position[2]])
    axes.plot(wrist[0] + np.array([0, _WRIST_TO_FINGERS]), wrist[[1, 1]], color=_GREY, lw=5,
              solid_capstyle='butt')
    axes.plot([0, 0], [0, wrist[1]], color=_GREY, lw=1, ls=':')
    axes.add_patch(Rectangle((-0.09, -0.02), 0.09, 0.04, color='#cccccc'))
    _frame(axes, wrist, 'mount_parent\n(wrist_roll_link)', ('x', _X, (1, 0)), ('z', _Z, (0, 1)),
           offset=-0.03)
    _frame(axes, np.zeros(2), 'frame_id\n(lytro_optical_frame)', ('z', _Z, (1, 0)),
           ('y', _Y, (0, -1)))
    axes.plot(0, 0, 'o', color=_X)  # x comes out of the paper
    axes.text(-0.012, -0.003, 'x', color=_X, ha='right', va='center')
    axes.set(aspect='equal', xlim=(-0.16, 0.97), ylim=(-0.17, 0.19))
    axes.set_axis_off()
    return drawn


def _planes(axes: Axes, near: float, far: float) -> None:
    for distance, name in ((near, 'near'), (far, 'far')):
        axes.plot([distance] * 2, [-0.13, 0.13], color='black', lw=1)
        axes.text(distance, 0.14, f'{name}\n{distance:g} m', ha='center', fontsize='small')


def _region(axes: Axes, search: PmclSettings) -> None:
    _, y, z = search.roi_center
    _, height, depth = search.roi_size
    axes.add_patch(Rectangle((z - depth / 2, -y - height / 2), depth, height, fill=False, ls='--',
                             ec='black'))
    axes.text(z + depth / 2 + 0.01, -y - height / 2,
              "roi_center, roi_size:\nhold the object's origin", fontsize='small', va='bottom')


def _object(axes: Axes, search: PmclSettings) -> None:
    turn = np.array([[np.cos(_TILT), np.sin(_TILT)], [-np.sin(_TILT), np.cos(_TILT)]])
    place = np.array([search.roi_center[2] + 0.02, -search.roi_center[1] + 0.01])
    both = np.concatenate([_OUTLINE, _OUTLINE[::-1] * [-1, 1]]) @ turn.T + place
    axes.fill(*both.T, color=_GLASS, alpha=0.45)
    _frame(axes, place, "pose: the mesh's frame", ('z', _Z, tuple(turn @ [0, 1])),
           ('x', _X, tuple(turn @ [-1, 0])), offset=0.1)


def _frame(axes: Axes, origin: NDArray[np.float64], name: str,
           *arrows: tuple[str, str, tuple[float, float]], offset: float = 0.035) -> None:
    for letter, colour, (x, y) in arrows:
        tip = origin[0] + _ARM * x, origin[1] + _ARM * y
        axes.annotate('', tip, tuple(origin), arrowprops={'arrowstyle': '-|>', 'color': colour,
                                                          'lw': 2})
        # beside the tip, clear of what the arrow points at
        axes.text(tip[0] + _BESIDE * y, tip[1] - _BESIDE * x, letter, color=colour, ha='center',
                  va='center')
    axes.text(origin[0], origin[1] + offset, name, fontsize='small', ha='center',
              va='bottom' if offset > 0 else 'top')
