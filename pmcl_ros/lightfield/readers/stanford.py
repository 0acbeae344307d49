"""File names of the Stanford Light Field Archive's rectified grids.

out_RR_CC_Y_X.png (or with one more _ before the dot): row, column, and where the camera was, in a
unit that the names do not tell.
"""

import re

NAMES = re.compile(r'out_(?P<row>\d+)_(?P<column>\d+)_(?P<y>[-+]?\d+(?:\.\d+)?)'
                   r'_(?P<x>[-+]?\d+(?:\.\d+)?)_?\.(?:png|jpg)', re.IGNORECASE)
HINT = """its files are called as the Stanford archive's, but their names tell positions without a
unit, and no focal length; write {name} there with `files: stanford`, `fx`, `focus_distance`
(the depth of the plane they were rectified to) and `unit` (metres of one unit) or `baseline`
(metres between neighbouring views)""".replace('\n', ' ')
