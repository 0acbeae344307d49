"""Media of the materials and liquids that users name."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from pmcl_ros.pmcl.appearance import Appearance, Liquid
from pmcl_ros.runtime.errors import ObjectModelError, PictureError, told_as
from pmcl_ros.runtime.picture_file import read_picture_file
from pmcl_ros.simulation.scenes.materials import Clear, Medium, Opaque
from pmcl_ros.simulation.scenes.textures import SIZE, Texture

_GAMMA = 2.2  # of pictures
_ONCE_AROUND = 0.19  # m: a texture lies undistorted on a wall 3 cm from the axis
# Index: soda-lime glass 1.52 (Rubin, Solar Energy Materials 12, 1985), acrylic (PMMA) 1.491
# (Sultanova et al., Acta Physica Polonica A 116, 2009), PET as blown into bottles 1.575
# (handbooks). Absorption: clear float glass lets through 0.90 of the light at 4 mm and 0.88 at
# 10 mm (EN 410 data sheets), which is 4/m, with a green tinge by iron; those of plastics are
# chosen lower or alike, that of tinted glass as bottle green. Roughness of ground glass: Beckmann
# width 0.344 (Walter et al., Microfacet models for refraction, 2007) over the root of 2.
_CLEAR = {'glass': Clear(1.52, (6.0, 3.0, 5.0)), 'acrylic': Clear(1.491, (0.5, 0.5, 0.5)),
          'pet': Clear(1.575, (4.0, 4.0, 5.0)), 'frosted': Clear(1.52, (6.0, 3.0, 5.0), 0.24),
          'tinted': Clear(1.52, (90.0, 25.0, 70.0))}
# Grey, under the coat that paints and most plastics have: chosen.
_COLOUR, _COAT, _COAT_ROUGHNESS = (0.5, 0.5, 0.5), 1.5, 0.2
# Water at 20 C: 1.333; it absorbs 0.3/m of red (Pope and Fry 1997). Coloured: as apple juice.
_LIQUIDS = {'water': Clear(1.333, (0.3, 0.06, 0.01)), 'coloured': Clear(1.34, (3.0, 15.0, 60.0))}
WATER = _LIQUIDS['water']


def medium_of(appearance: Appearance, folder: Path) -> Medium:
    """What an object is made of. folder: of its YAML file.

    Raises ObjectModelError when its texture cannot be read.
    """
    if appearance.material == 'opaque':
        return Opaque(_texture(appearance, folder), appearance.texture_side or _ONCE_AROUND,
                      _given(appearance.index, _COAT),
                      _given(appearance.roughness, _COAT_ROUGHNESS))
    usual = _CLEAR[appearance.material]
    return Clear(_given(appearance.index, usual.index), appearance.absorption or usual.absorption,
                 _given(appearance.roughness, usual.roughness))


def liquid_of(liquid: Liquid) -> Clear:
    """What a vessel holds."""
    usual = _LIQUIDS[liquid.kind]
    return replace(usual, absorption=liquid.absorption or usual.absorption)


def _given(value: float | None, usual: float) -> float:
    return usual if value is None else value


def _texture(appearance: Appearance, folder: Path) -> Texture:
    """A picture as linear reflectances, or one colour."""
    if appearance.texture is None:
        colour = np.array(appearance.colour or _COLOUR, np.float32)
        return np.broadcast_to(colour, (SIZE, SIZE, 3))
    path = folder / appearance.texture
    with told_as(ObjectModelError, PictureError, name='appearance.texture'):
        picture = read_picture_file(path, cv2.IMREAD_COLOR)
    linear = (picture[..., ::-1].astype(np.float32) / np.float32(255)) ** np.float32(_GAMMA)
    return np.asarray(cv2.resize(linear, (SIZE, SIZE), interpolation=cv2.INTER_AREA), np.float32)
