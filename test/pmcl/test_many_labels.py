"""Views far apart take many edge labels: more than OpenCV has channels."""

import cv2
import numpy as np
import pytest

from pmcl_ros.pmcl.render.contour import smoothed


@pytest.mark.parametrize('labels', [1, 42, 43, 200])
def test_each_label_is_blurred_as_a_picture_of_its_own(labels):
    tensor = np.random.default_rng(labels).random((17, 23, labels, 3), np.float32)
    found = smoothed(tensor, 1.3)
    assert found.dtype == np.float32
    for label in range(labels):
        expected = cv2.GaussianBlur(tensor[:, :, label], (0, 0), 1.3)
        np.testing.assert_allclose(found[:, :, label], expected, atol=1e-6)
