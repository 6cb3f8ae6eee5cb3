"""What a camera sees, by rays: which geom, ball or box is at each pixel; and which pixels have a colour."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, binary_erosion

from workcell.record.render.raster import Camera

Mask = NDArray[np.bool_]

VISIBLE = np.array([1, 1, 1, 0, 0, 0], dtype=np.uint8)
"""MuJoCo's groups of what is there to be looked at."""


def rays(camera: Camera) -> NDArray[np.float64]:
    """Directions (h, w, 3), of length 1, from the camera through the middle of each pixel."""
    forward = camera.target - camera.position
    forward = forward / np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    down = np.cross(forward, right)
    step = 2 * np.tan(np.radians(camera.fov_deg) / 2) / camera.height
    x = (np.arange(camera.width) + 0.5 - camera.width / 2) * step
    y = (np.arange(camera.height) + 0.5 - camera.height / 2) * step
    through = forward + x[None, :, None] * right + y[:, None, None] * down
    directions: NDArray[np.float64] = through / np.linalg.norm(through, axis=2, keepdims=True)
    return directions


def geoms_seen(
    model: mujoco.MjModel, data: mujoco.MjData, camera: Camera
) -> tuple[NDArray[np.int32], NDArray[np.float64]]:
    """The geom that each pixel looks at, -1 where none, and how far it is, infinitely where none: both (h, w)."""
    count, shape = camera.width * camera.height, (camera.height, camera.width)
    geom, distance = np.empty(count, dtype=np.int32), np.empty(count)
    at, towards = np.asarray(camera.position, dtype=float), rays(camera).reshape(-1)
    mujoco.mj_multiRay(
        model, data, at, towards, VISIBLE, True, -1, geom, distance, None, count, mujoco.mjMAXVAL
    )
    return geom.reshape(shape), np.where(geom >= 0, distance, np.inf).reshape(shape)


def ball_at(camera: Camera, centre: Any, radius: float) -> NDArray[np.float64]:
    """How far each pixel looks until it meets a ball (h, w); infinitely where it does not."""
    to_centre = np.asarray(centre) - camera.position
    ahead = rays(camera) @ to_centre
    rest = radius**2 - (to_centre @ to_centre - ahead**2)
    return np.where((rest > 0) & (ahead > 0), ahead - np.sqrt(np.maximum(rest, 0.0)), np.inf)


def box_at(camera: Camera, low: Any, high: Any) -> Mask:
    """Pixels (h, w) that look at an axis-aligned box, if nothing hides it."""
    towards = rays(camera)
    first, second = (
        (np.asarray(low) - camera.position) / towards,
        (np.asarray(high) - camera.position) / towards,
    )
    enter, leave = np.minimum(first, second).max(axis=2), np.maximum(first, second).min(axis=2)
    mask: Mask = (leave > 0) & (enter < leave)
    return mask


def coloured(picture: NDArray[Any], rgb: Any, within: float = 0.01) -> Mask:
    """Pixels (h, w) that a matt or glossy thing of a colour can have in sun or shade.

    That is the colour, darker or lighter, and a little white.
    """
    colour = np.asarray(rgb, dtype=float)[:3]
    apart, mean = colour - colour.mean(), picture.mean(axis=2)
    if np.abs(apart).max() > 1e-3:
        strength = (picture - mean[..., None]) @ apart / (apart @ apart)
        gloss = np.clip(mean - strength * colour.mean(), 0.0, 0.2)
    else:
        gloss = np.zeros_like(mean)
    strength = (picture - gloss[..., None]) @ colour / (colour @ colour)
    rest = np.abs(picture - strength[..., None] * colour - gloss[..., None]).max(axis=2)
    mask: Mask = (rest < within) & (strength > 0.2) & (strength < 1.2)
    return mask


def inside(mask: Mask, by: int = 2) -> Mask:
    """The pixels of a mask that are more than `by` pixels away from its edge."""
    inner: Mask = binary_erosion(mask, iterations=by, border_value=1)
    return inner


def around(mask: Mask, by: int = 2) -> Mask:
    """A mask and all pixels within `by` pixels of it."""
    outer: Mask = binary_dilation(mask, iterations=by)
    return outer
