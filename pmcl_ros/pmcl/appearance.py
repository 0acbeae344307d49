"""What an object is made of, as its YAML file says it."""

from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from pmcl_ros.runtime.settings import Settings

Material = Literal['glass', 'acrylic', 'pet', 'frosted', 'tinted', 'opaque']
Share = Annotated[float, Field(ge=0, le=1)]
Absorption = Annotated[float, Field(ge=0, le=10_000)]
_SCATTERING = 'frosted', 'opaque'
_OPAQUE_ONLY = 'colour', 'texture', 'texture_side'
_THICKNESS = 'wall', 'inner', 'solid'


class Mouth(Settings):
    """Where a vessel is open."""

    z: float | None = Field(None, description='height of its rim [m]; needed where it is open')
    open: bool = Field(True, description='false: the vessel is a closed hollow')

    @model_validator(mode='after')
    def _placed(self) -> 'Mouth':
        if self.open and self.z is None:
            raise ValueError('an open mouth needs its height z [m]')
        return self


class Liquid(Settings):
    """What a vessel holds."""

    level: float = Field(description='height of its surface [m]')
    kind: Literal['water', 'coloured'] = 'water'
    absorption: tuple[Absorption, Absorption, Absorption] | None = Field(
        None, description='of red, green, blue [1/m]; default: of the kind')


class Appearance(Settings):
    """Section `appearance` of an object's YAML file.

    Heights are along `up`, from the origin of the mesh, in metres.
    """

    material: Material
    index: float | None = Field(None, ge=1, le=3, description='refractive index; of an opaque '
                                'object that of its coat, 1: none; default: of the material')
    absorption: tuple[Absorption, Absorption, Absorption] | None = Field(
        None, description='of red, green, blue [1/m]; default: of the material')
    roughness: float | None = Field(None, ge=0, le=1, description='standard deviation of the '
                                    'slope of its surface [1]; default: of the material')
    colour: tuple[Share, Share, Share] | None = Field(
        None, description='reflectance of an opaque object [1], linear red, green, blue')
    texture: str | None = Field(None, description='picture wound about an opaque object, its path '
                                'relative to this file')
    texture_side: float | None = Field(None, gt=0, le=10, description='width and height of that '
                                       'picture on a wall 3 cm from the axis [m]; default: once '
                                       'around')
    wall: float | None = Field(None, ge=1e-4, le=0.1, description='thickness of the wall [m]')
    inner: str | None = Field(None, description='mesh of the inner surface, its path relative to '
                              'this file; frame and scale of the mesh')
    solid: bool = Field(False, description='true: the mesh is filled with the material')
    mouth: Mouth | None = None
    floor: float | None = Field(None, description='height below which a vessel is massive, as '
                                'stems and thick feet are [m]; default: the wall')
    liquid: Liquid | None = Field(None, description='in it; it then stands upright')
    up: tuple[float, float, float] | None = Field(
        None, description='direction in the mesh frame that points up when the object stands; '
        'default: the axis of symmetry, z where there is none')

    @property
    def is_clear(self) -> bool:
        """Whether it shows what is behind it, as it does not scatter light."""
        return self.material not in _SCATTERING and not self.roughness

    @property
    def has_ends(self) -> bool:
        """Whether it says which end is up, whatever the outside looks like."""
        return bool(self.up or self.liquid or (self.mouth and self.mouth.open))

    @property
    def declared_up(self) -> NDArray[np.float64] | None:
        """(3,) `up`, of any length."""
        return None if self.up is None else np.array(self.up, np.float64)

    @model_validator(mode='after')
    def _consistent(self) -> 'Appearance':
        opaque = self.material == 'opaque'
        wrong = [name for name in (('absorption',) if opaque else _OPAQUE_ONLY)
                 if getattr(self, name) is not None]
        if wrong:
            raise ValueError(f'{wrong[0]} is not for {self.material}: opaque objects have '
                             'colour or texture, transparent ones absorption')
        if self.colour is not None and self.texture is not None:
            raise ValueError('give colour or texture, not both')
        given = [name for name in _THICKNESS if getattr(self, name)]
        if len(given) > 1:
            raise ValueError(f'give one of {", ".join(_THICKNESS)}, not {" and ".join(given)}')
        hollow = {'mouth': self.mouth, 'floor': self.floor, 'liquid': self.liquid}
        needless = [name for name, value in hollow.items() if value is not None]
        if needless and not (self.wall or self.inner):
            raise ValueError(f"{needless[0]} is for hollow objects: write 'wall: 0.0025', the "
                             "thickness [m], or 'inner: inner.stl', the inner surface"
                             + (', in place of solid' if self.solid else ', too'))
        if self.up is not None and not sum(each * each for each in self.up) > 0:
            raise ValueError('up must not be 0')
        return self
