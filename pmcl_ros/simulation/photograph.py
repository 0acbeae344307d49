"""What an ordinary camera makes of the light on its sensor: a picture of 8 bits."""

import cv2
import numpy as np
from numpy.typing import NDArray

MARGIN = 10  # px: light beyond the picture's border that blur brings in
_LEVELS = 0.1, 0.55  # mean of a picture's light, 1 at the sensor's white
_WHITE = 65535  # count of a mosaic of 16 bits, as OpenCV takes it

Light = NDArray[np.float32]


def photograph(rng: np.random.Generator, light: Light, off_axis: Light) -> NDArray[np.uint8]:
    """Draw a camera and a picture it makes, (height, width, 3) uint8 RGB, gamma encoded.

    light: (height + 2 MARGIN, width + 2 MARGIN, 3) mean radiance of each pixel. off_axis: (height,
    width) distance of each pixel from the optical axis, 1 at the sensor's corners. Drawn are
    exposure, blur, vignetting, noise, a colour filter array, colours, contrast, sharpening and
    JPEG. Nothing moves the picture by more than 0.1 px.
    """
    light = light * np.float32(_exposed(rng, light))
    picture = _blurred(rng, light)[MARGIN:-MARGIN, MARGIN:-MARGIN]
    if rng.random() < 0.5:
        picture = picture * (1 - np.float32(rng.uniform(0, 0.6)) * off_axis[..., None] ** 2)
    grey = rng.random() < 0.15
    if grey:
        weights = rng.dirichlet([3, 6, 2])  # of red, green, blue
        picture = picture @ weights[:, None].astype(np.float32)
    balance = np.exp(rng.normal(0, 0.35, 1 if grey else 3)).clip(0.4, 2.2)
    raw = _noisy(rng, np.asarray(picture / balance, np.float32))
    if not grey and rng.random() < 0.6:
        raw = _demosaiced(rng, raw)
    cast = 1.0 if grey else np.exp(rng.normal(0, rng.choice([0.02, 0.12]), 3))
    linear = np.clip(raw * (balance * cast).astype(np.float32), 0, 1)
    if not grey:
        tone = linear.mean(axis=2, keepdims=True)
        linear = np.clip(tone + np.float32(rng.uniform(0.2, 1.2)) * (linear - tone), 0, 1)
    encoded = np.asarray(linear ** np.float32(1 / rng.uniform(1.8, 2.5)), np.float32)
    curve = np.float32(rng.uniform(-0.2, 0.6))
    encoded = (1 - curve) * encoded + curve * encoded ** 2 * (3 - 2 * encoded)
    picture = np.repeat(encoded, 3, axis=2) if grey else encoded
    return _compressed(rng, _finished(rng, np.clip(picture, 0, 1)))


def _exposed(rng: np.random.Generator, light: Light) -> float:
    """A gain: usually as a camera meters, at times too little or too much."""
    level = float(np.exp(rng.uniform(*np.log(_LEVELS))))
    gain = level / max(float(light.mean()), 1e-6)
    if rng.random() < 0.75:
        bright = float(np.percentile(light, rng.uniform(85, 99.5)))
        gain = min(gain, rng.uniform(0.7, 1.0) / max(bright, 1e-6))
    return gain


def _blurred(rng: np.random.Generator, light: Light) -> Light:
    """Saturated far beyond white, blurred by lens and pixels; maybe out of focus or in motion."""
    light = np.minimum(light, np.float32(8))
    sigma = float(rng.uniform(0.45, 1.3))
    light = np.asarray(cv2.GaussianBlur(light, (0, 0), sigma), np.float32)
    draw = rng.random()
    if draw < 0.2:
        light = np.asarray(cv2.filter2D(light, -1, _disc(float(rng.uniform(0.5, 4)))), np.float32)
    elif draw < 0.35:
        length, turn = rng.uniform(1, 8), rng.uniform(0, np.pi)
        light = np.asarray(cv2.filter2D(light, -1, _line(length, turn)), np.float32)
    return light


def _disc(radius: float) -> NDArray[np.float32]:
    """A kernel of sum 1: a disc with an antialiased border."""
    side = np.arange(-np.ceil(radius + 1), np.ceil(radius + 1) + 1)
    kernel = np.clip(radius + 0.5 - np.hypot(side[:, None], side), 0, 1)
    return np.asarray(kernel / kernel.sum(), np.float32)


def _line(length: float, turn: float) -> NDArray[np.float32]:
    """A kernel of sum 1: a line through the middle, antialiased."""
    side = np.arange(-np.ceil(length / 2 + 1), np.ceil(length / 2 + 1) + 1)
    along = side * np.cos(turn) + side[:, None] * np.sin(turn)
    across = side * np.sin(turn) - side[:, None] * np.cos(turn)
    kernel = np.clip(length / 2 + 0.5 - abs(along), 0, 1) * np.clip(1 - abs(across), 0, 1)
    return np.asarray(kernel / kernel.sum(), np.float32)


def _noisy(rng: np.random.Generator, light: Light) -> Light:
    """With photon and read noise, clipped at the sensor's white."""
    shot = np.exp(rng.uniform(np.log(2e-5), np.log(2e-3)))
    read = np.exp(rng.uniform(np.log(5e-4), np.log(1e-2)))
    light = np.clip(light, 0, 1)
    sigma = np.sqrt(np.float32(shot) * light + np.float32(read ** 2))
    return np.clip(light + sigma * rng.standard_normal(light.shape, np.float32), 0, 1)


def _demosaiced(rng: np.random.Generator, raw: Light) -> Light:
    """Seen through a colour filter array, whose gaps are filled from neighbours."""
    mosaic = raw[..., 1].copy()
    row, column = (int(each) for each in rng.integers(0, 2, 2))
    mosaic[row::2, column::2] = raw[row::2, column::2, 0]
    mosaic[1 - row::2, 1 - column::2] = raw[1 - row::2, 1 - column::2, 2]
    edges = '_EA' if rng.random() < 0.5 else ''
    # OpenCV names a pattern by the second row's second and third pixel.
    name = {(0, 0): 'BG', (0, 1): 'GB', (1, 0): 'GR', (1, 1): 'RG'}[row, column]
    code = getattr(cv2, f'COLOR_Bayer{name}2RGB{edges}')
    values = np.rint(mosaic * _WHITE).astype(np.uint16)
    return np.asarray(cv2.demosaicing(values, code), np.float32) / np.float32(_WHITE)


def _finished(rng: np.random.Generator, picture: Light) -> Light:
    """Smoothed against noise and sharpened, each at times."""
    if rng.random() < 0.2:
        picture = np.asarray(cv2.bilateralFilter(np.asarray(picture, np.float32), 5,
                                                 rng.uniform(0.02, 0.1), 1.5), np.float32)
    if rng.random() < 0.4:
        smooth = cv2.GaussianBlur(picture, (0, 0), float(rng.uniform(0.7, 1.5)))
        picture = picture + np.float32(rng.uniform(0.2, 1.5)) * (picture - smooth)
    return np.clip(picture, 0, 1)


def _compressed(rng: np.random.Generator, picture: Light) -> NDArray[np.uint8]:
    """Of 8 bits, 60 % of them through JPEG."""
    values = np.rint(255 * picture).astype(np.uint8)
    if rng.random() < 0.4:
        return values
    quality = int(rng.integers(35, 98))
    _, code = cv2.imencode('.jpg', values[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality])
    return np.asarray(cv2.imdecode(code, cv2.IMREAD_COLOR), np.uint8)[..., ::-1].copy()
