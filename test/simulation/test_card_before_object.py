"""Cards before objects in simulated views."""

import numpy as np

from pmcl_ros.simulation.card import with_card

GREY = np.full((240, 320, 3), 120, np.uint8)


def outline(x, y, radius):
    angles = np.linspace(0, 2 * np.pi, 40)
    return np.stack([x + radius * np.cos(angles), y + radius * np.sin(angles)], axis=1)


def test_a_card_hides_most_of_the_object_and_little_else():
    for seed in range(20):
        covered = with_card(GREY, outline(150, 110, 30), np.random.default_rng(seed))
        changed = (covered != GREY).any(axis=2)
        across, down = np.meshgrid(np.arange(320) - 150, np.arange(240) - 110)
        away = np.hypot(across, down)
        assert changed[away < 30].mean() > 0.85
        assert not changed[away > 30 * 2.5].any()
        again = with_card(GREY, outline(150, 110, 30), np.random.default_rng(seed))
        assert (again == covered).all()


def test_behind_the_camera_nothing_is_hidden():
    behind = np.full((5, 2), np.nan)
    assert (with_card(GREY, behind, np.random.default_rng(0)) == GREY).all()
