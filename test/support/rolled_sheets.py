"""Sheets of paper that are rolled along a line, exactly: lengths on them stay."""

import numpy as np


def rolled(flat, height, degrees=0, shape='gutter'):
    """(m, 3) where the corners (m, 3) of a sheet that was flat lie [m].

    height: at the farthest corner from the middle, across the line [m]. degrees: of the direction
    across to x. shape: 'gutter', or 'curled' at one side only.
    """
    across = np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees)), 0])
    middle = (flat.min(axis=0) + flat.max(axis=0)) / 2
    along = (flat - middle) @ across
    reach = np.abs(along).max()

    def up(place):
        share = place / reach
        return height * (share ** 2 if shape == 'gutter'
                         else np.square(np.maximum(share - 0.2, 0) / 0.8))

    places = np.linspace(-1.1, 1.1, 20001) * reach
    lengths = np.cumsum(np.append(0, np.hypot(np.diff(places), np.diff(up(places)))))
    lengths -= np.interp(0, places, lengths)
    moved = np.interp(along, lengths, places)
    return flat + np.outer(moved - along, across) + np.outer(up(moved), [0, 0, 1])
