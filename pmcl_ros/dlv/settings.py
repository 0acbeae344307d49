"""Parameters of the depth likelihood volume."""

from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from pmcl_ros.runtime.settings import Odd, Settings

BackEnd = Literal['auto', 'numba', 'gl']
LayersFrom = Literal['volume', 'joint']
MOST_LABELS = 1000  # of the volume, and of the edges
MOST_STRIDE = 16  # px: ten rays across an object of the size that searches are made for
_NEAR, _FAR = (0.01, 100.0), (0.01, 1000.0)  # m: from, to
_Pixels = Annotated[int, Field(ge=0, le=100_000)]


class DlvSettings(Settings):
    """LightField -> DepthLikelihoodVolume; the symbols are those of the paper's section V.A."""

    near: float = Field(0.3, ge=_NEAR[0], le=_NEAR[1],
                        description='depth of the nearest label [m]')
    far: float = Field(0.9, ge=_FAR[0], le=_FAR[1],
                       description='depth of the farthest label [m]')
    labels: int = Field(75, ge=3, le=MOST_LABELS,
                        description='number of depth labels, uniform in inverse depth [labels]')
    views: Odd = Field(7, ge=3, le=99,
                       description='side of the square of inner views compared, odd [views]')
    window: Odd = Field(5, ge=1, le=99,
                        description='side of the square R_x over which costs are summed, odd [px]')
    beta: float = Field(0.5, ge=0, le=1,
                        description='share of the colour cost, the rest is the gradient cost [1]')
    tau_color: float = Field(0.5, ge=0.001, le=10,
                             description='colour distance that counts no further, tau_1 [1]')
    tau_gradient: float = Field(
        0.5, ge=0.001, le=10,
        description='gradient difference that counts no further, tau_2 [1/px]')
    color_cost: Literal['l2', 'sad'] = Field(
        'l2', description='colour distance over RGB: l2 as in the paper, or sad, the sum of '
        'absolute differences')
    interpolation: Literal['neutral', 'phase', 'bilinear'] = Field(
        'neutral', description='how views are sampled between pixels: neutral leaves noise as '
        'strong at every displacement; phase shifts exactly (the paper; many seconds); bilinear '
        'averages noise, and so favours labels of half-pixel displacement on flat pixels')
    view_weights: Literal['light', 'equal'] = Field(
        'light', description='how much a view counts: light, by the light it got, since a dim '
        'view is a noisy one; equal, as in the paper')
    crop: tuple[_Pixels, _Pixels, _Pixels, _Pixels] = Field(
        (0, 0, 0, 0), description='left, top, width, height of the part of the centre view that '
        'gets a volume; a size of 0 is up to the end of the image [px]')
    stride: int = Field(
        1, ge=1, le=MOST_STRIDE, description='only every stride-th pixel of the crop, across and '
        'down, gets a ray; the window sums over such pixels alone [px]')
    truncate: bool = Field(
        False, description='keep only the highest local maxima of each pixel, set the rest to 0')
    maxima: int = Field(2, ge=1, le=100,
                        description='local maxima kept when truncating, N_lm [labels]')
    neighbours: int = Field(
        2, ge=0, le=100,
        description='labels kept each side of a maximum when truncating, K_lm [labels]')
    edge_labels: int = Field(24, ge=2, le=MOST_LABELS,
                             description='number of depth labels of the edge volume [labels]')

    layers: LayersFrom = Field(
        'volume', description='source of the two-layer picture: volume, the maxima of the '
        'likelihood; joint, also a joint fit of two layers to all views, where the likelihood '
        'has one maximum only. The fit separates layers far below a pixel per view step; a '
        'volume then takes 2 to 3.5 times as long')
    back_end: BackEnd = Field(
        'auto', description='what makes the volume: numba, on the processor; gl, compute shaders; '
        'auto, gl where OpenGL runs on a GPU, else numba. Interpolation phase has a form '
        'of its own, and refuses gl')

    @model_validator(mode='after')
    def _ordered(self) -> 'DlvSettings':
        if self.near >= self.far:
            raise ValueError(f'near {self.near} m must be smaller than far {self.far} m')
        return self

    @model_validator(mode='after')
    def _has_form(self) -> 'DlvSettings':
        if self.back_end == 'gl' and self.interpolation == 'phase':
            raise ValueError('interpolation phase has no form for back_end gl: choose back_end '
                             'auto, or interpolation neutral or bilinear')
        return self


def within_limits(near: float, far: float) -> dict[str, float]:
    """`near` and `far` of the settings for these depths [m], as far as they are allowed."""
    return {'near': float(np.clip(near, *_NEAR)), 'far': float(np.clip(far, *_FAR))}
