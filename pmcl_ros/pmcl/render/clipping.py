"""Clips triangles by what a camera can see of them."""

import numpy as np

from pmcl_ros.pmcl.render.refraction import apparent
from pmcl_ros.runtime.kernels import compiled

CORNERS = 8  # that a triangle has at most, clipped by five planes


@compiled(inner=True)
def clipped(vertices, face, pose, camera, width, height, near,  # type: ignore[no-untyped-def]
            water, reach):
    """(CORNERS, 3) corners before the camera [m], and how many they are, of the part of a triangle
    beyond `near` and up to `reach` pixels outside of the picture.

    vertices: (3, n) of the mesh; face: (3,) of them. camera: fx, fy, cx, cy. water: as of
    `refraction.apparent`. Clips by one plane after the other (Sutherland and Hodgman, Reentrant
    polygon clipping, 1974).
    """
    fx, fy, cx, cy = camera
    polygon = np.zeros((CORNERS, 3), np.float64)
    distances = np.zeros(CORNERS, np.float64)
    for k in range(3):
        for axis in range(3):
            polygon[k, axis] = pose[axis, 3]
            for j in range(3):
                polygon[k, axis] += float(pose[axis, j]) * vertices[j, face[k]]
        if len(water) > 0:
            polygon[k] = apparent(polygon[k, 0], polygon[k, 1], polygon[k, 2], water)
    count = 3
    for plane in range(5):
        for k in range(count):
            distances[k] = _inside(polygon[k], plane, fx, fy, cx, cy, width, height, near, reach)
        kept = 0
        result = np.zeros((CORNERS, 3), np.float64)
        for k in range(count):
            here, there = distances[k], distances[(k + 1) % count]
            if here >= 0:
                for axis in range(3):
                    result[kept, axis] = polygon[k, axis]
                kept += 1
            if (here >= 0) != (there >= 0):
                part = here / (here - there)
                point = polygon[k] + part * (polygon[(k + 1) % count] - polygon[k])
                for axis in range(3):
                    result[kept, axis] = point[axis]
                kept += 1
        polygon, count = result, kept
    return polygon, count


@compiled(inner=True)
def _inside(p, plane, fx, fy, cx, cy, width, height, near, reach):  # type: ignore[no-untyped-def]
    """How far inside one of the five planes a point is; of any scale."""
    if plane == 0:
        return p[2] - near
    if plane == 1:
        return fx * p[0] + (cx + 0.5 + reach) * p[2]
    if plane == 2:
        return (width + reach - cx - 0.5) * p[2] - fx * p[0]
    if plane == 3:
        return fy * p[1] + (cy + 0.5 + reach) * p[2]
    return (height + reach - cy - 0.5) * p[2] - fy * p[1]
