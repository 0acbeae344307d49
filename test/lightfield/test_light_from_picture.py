import numpy as np
import pytest
from lattice_frames import discs, frame_of, make_lattice, mosaic, offsets, pixels, texture

from pmcl_ros.lightfield.light_from_picture import light_from_picture
from pmcl_ros.lightfield.white_image import relative_light
from pmcl_ros.runtime.errors import LightFieldError

SIDE = 700


def compared(camera_text, lattice, light, scene, reach):
    """Relative rms difference to the white image's light within `reach` pitches of a centre."""
    white = relative_light(frame_of(0.6 * light, camera_text, 0.002))
    found = light_from_picture(frame_of(scene * light, camera_text, 0.005), lattice)
    assert found.shape == (SIDE, SIDE)
    assert found.dtype == np.float32
    near = np.hypot(*np.moveaxis(offsets(lattice, pixels(SIDE)), -1, 0)) < reach * lattice.pitch_px
    ratio = (found / np.maximum(white, 0.05))[near]
    assert np.median(ratio) == pytest.approx(1, abs=0.03)
    return np.sqrt(np.mean((ratio / np.median(ratio) - 1) ** 2))


@pytest.mark.parametrize('pitch', [7.2, 9.93, 19])
def test_it_is_the_light_of_the_white_image(camera_text, pitch):
    lattice = make_lattice(pitch)
    scene = texture(SIDE, 30) * mosaic([0.5, 1, 1, 0.7], SIDE)
    assert compared(camera_text, lattice, discs(lattice, SIDE, 0.46), scene, 0.35) < 0.03


def test_it_knows_the_rim_of_the_main_lens(camera_text):
    lattice = make_lattice()
    light = discs(lattice, SIDE, 0.48, cut=0.2)
    found = light_from_picture(frame_of(texture(SIDE, 30) * light, camera_text), lattice)
    corner = np.s_[:150, :150]
    missed, unaware = (np.sqrt(np.mean((each - light)[corner] ** 2))
                       for each in (found / found.max(), discs(lattice, SIDE, 0.48)))
    assert 3 * missed < unaware


def test_each_colour_has_its_own(camera_text):
    """Where red falls to another place than blue, views must not be tinted."""
    lattice = make_lattice()
    apart = offsets(lattice, pixels(SIDE))
    tilt = mosaic([-0.03, 0, 0, 0.03], SIDE)  # per px along x: blue, green, green, red
    light = discs(lattice, SIDE, 0.46) * (1 + tilt * apart[..., 0])
    scene = texture(SIDE, 30) * mosaic([0.5, 1, 1, 0.7], SIDE)
    assert compared(camera_text, lattice, light, scene, 0.35) < 0.03


def test_saturated_lenslets_do_not_count(camera_text):
    lattice = make_lattice()
    scene = np.full((SIDE, SIDE), 0.4)
    scene[:, SIDE // 2:] = 1.4  # the middles of these discs are cut off
    light = discs(lattice, SIDE, 0.46)
    assert compared(camera_text, lattice, light, scene, 0.35) < 0.03


@pytest.mark.parametrize('level', [0.0, 3.0])
def test_too_few_lenslets_are_refused(camera_text, level):
    lattice = make_lattice()
    with pytest.raises(LightFieldError, match=r'only .* lenslets'):
        light_from_picture(frame_of(level * discs(lattice, SIDE), camera_text), lattice)
