"""Rules about sizes: what the camera sees, sharp or at all, and lengths in other units."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .look import SIDE, Finding, Look

#: Sizes of the scene beyond which a camera is far away.
FAR = 1e3
#: Share of what is in view that clipping planes may cut off.
CUT = 0.01
#: Width of the blur of what is in view, as a share of the picture's.
BLUR = 0.5
#: Optical depth of a medium below which it cannot be seen.
THIN = 1e-4


def view(look: Look) -> list[Finding]:
    """Cameras that see nothing, and such that see the scene as a dot."""
    scene = look.scene
    if not look.total:
        return []
    _, primitive, _ = look.camera_hits
    low, high = look.bounds
    eye = np.asarray(scene.camera.to_world)[:3, 3]
    size, away = (float(np.linalg.norm(x)) for x in (high - low, eye - (low + high) / 2))
    if scene.camera.projection == "perspective" and away > FAR * size > 0:
        text = f"the camera is {away:.3g} away from a scene of size {size:.3g}"
        reason = f"more than {FAR:g} times its size: are both in the same unit?"
        return [Finding("size", "", scene.place(""), text, reason)]
    if (primitive < 0).all() and not scene.camera.measures:
        text = f"none of {SIDE**2} rays of the camera meets a surface"
        reason = "it looks past the scene, or away from it: a camera looks along its local +Z"
        return [Finding("view", "", scene.place(""), text, reason)]
    return []


def clip(look: Look) -> list[Finding]:
    """Near and far planes that cut off a part of what is in view."""
    scene = look.scene
    t, primitive, _ = look.camera_hits
    seen = primitive >= 0
    if not seen.any() or scene.camera.measures:
        return []
    _, directions = look.camera_rays
    depth = t[seen] * (directions[seen] @ np.asarray(scene.camera.placed)[:3, 2])
    near, far = scene.camera.clip_depths
    if scene.camera.projection == "orthographic":
        near, far = 0.0, far - near  # rays start at the near plane
    found = []
    for cut, name, value, what in (
        (depth < near, "near_clip", near, "nearer"),
        (depth > far, "far_clip", far, "farther"),
    ):
        if cut.mean() > CUT:
            text = f"{cut.mean():.0%} of what is in view is {what} than {name} = {value:.4g}"
            reason = (
                f"it is cut off; depths in view are {depth.min():.3g} to {depth.max():.3g}, and "
                "Mitsuba's planes are at 0.01 and 10,000 where the file names none"
            )
            found.append(Finding("clip", "", scene.place(""), text, reason))
    return found


def lens(look: Look) -> list[Finding]:
    """A lens through which nothing in view is sharp."""
    scene, camera = look.scene, look.scene.camera
    t, primitive, _ = look.camera_hits
    seen = primitive >= 0
    if not camera.aperture_radius or not seen.any():
        return []
    _, directions = look.camera_rays
    depth = t[seen] * (directions[seen] @ np.asarray(camera.placed)[:3, 2])
    width = 2 * camera.tan_half_x(scene.film.width, scene.film.height)
    blur = 2 * camera.aperture_radius * np.abs(1 / camera.focus_distance - 1 / depth) / width
    least = float(np.quantile(blur, 0.02))
    if least <= BLUR:
        return []
    text = (
        f"with aperture_radius = {camera.aperture_radius:.3g} and focus_distance = "
        f"{camera.focus_distance:.3g}, points in view blur over {least:.2g} of the picture's width"
    )
    reason = (
        f"depths in view are {depth.min():.3g} to {depth.max():.3g}: are the lens and the scene in "
        "the same unit?"
    )
    return [Finding("lens", "", scene.place(""), text, reason)]


def media(look: Look) -> list[Finding]:
    """Media so thin that nothing is seen of them."""
    scene, found = look.scene, []
    sides = np.asarray(scene.boundaries)
    for row in range(len(scene.sigma_t)):
        mine = np.flatnonzero(np.isin(look.boundary, np.flatnonzero((sides == row).any(axis=1))))
        thick = float(np.asarray(scene.sigma_t)[row].max())
        if not len(mine) or not thick:
            continue
        boxes = np.concatenate([look.box(kind) for kind in range(3) if look.counts[kind]], axis=1)
        low, high = boxes[0][mine].min(axis=0), boxes[1][mine].max(axis=0)
        size = float(np.linalg.norm(high - low))
        if thick * size < THIN:
            depth = thick * size
            text = f"size {size:.3g} and sigma_t = {thick:.3g} make an optical depth of {depth:.2g}"
            reason = "sigma_t is per unit of length: so little cannot be seen; another unit?"
            found.append(look.found("size", "sigma_t", row, text, reason))
    return found


CHECKS: tuple[Callable[[Look], list[Finding]], ...] = (view, clip, lens, media)
