"""Feature images: what the camera sees first, as depth, normals, colours and numbers.

They are of the first surface that a ray of the camera meets. The rays are those of the picture: the
same random numbers, pixel filter and lens, so its first samples and theirs meet the same points. A
ray goes on through null surfaces, through uncovered parts of masks, through lamps that the camera
does not see (`hide_emitters`) and through media. A mirror or glass is itself, not what it shows.

Means over the samples of a pixel that meet a surface, each with its standard error; `alpha` is the
share of those samples. Where none does, depths are infinite and all others 0. A filter with
negative lobes counts without its sign: a mean lies between the numbers that it is of.

- `depth` (H, W): distance along the ray from the camera or the point of its lens, in world units.
- `depth_axis` (H, W): the same along the camera's axis.
- `position` (H, W, 3): of the point, in the world.
- `normal` (H, W, 3): of shading, interpolated and turned by normal and bump maps; of the surface's
  front, whichever side is seen. Means of unit vectors, so shorter where they differ.
- `geo_normal` (H, W, 3): of the face.
- `albedo` (H, W, 3): share of the light towards the camera that the surface sends on, by mirror,
  base and transmission together, as its material states it; 0 for what takes all light, as the back
  of a one-sided surface does. Mitsuba's `albedo` is the diffuse part of it.
- `uv` (H, W, 2): texture coordinates, as Mitsuba has them. Only scenes that have some: the reader
  keeps those of meshes where something is textured.
- `motion` (H, W, 2): pixels to the right and down from the point's image in this camera to that in
  the camera `motion_to`, of the same film; 0 for points behind one of them.
- `alpha` (H, W): share of the samples that meet a surface; always there beside another mean.

Numbers (H, W) uint32 of what the ray through the centres of pixel and lens meets, 0 for nothing;
never filtered:

- `object`: 1 + the shape in `Scene.shape_names`.
- `material`: 1 + the row of the scene's materials (of a blend, the row that blends).
- `primitive`: 1 + the triangle, T + the sphere or T + S + the disk of T triangles and S spheres.

Parts of the picture (H, W, 3), each of which costs another picture with the same samples:

- `direct`: paths of two segments at most: what lamps send to the camera, and what they light.
- `indirect`: all longer paths. The two add up to the picture to float rounding.
- `light.NAME`: the light of the lamps of a group (`veriray.light_groups`). The groups add up to the
  picture to float rounding.

In EXR files a layer has the image's name, `depth.Z` and `normal.X` for example (`LAYERS`), and its
standard error is the layer `stderr.NAME`.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from .numeric import array, shown, texts, whole
from .settings import FEATURES

if TYPE_CHECKING:
    from .picture import Render

Array = npt.NDArray[Any]

#: Letters of the channels by image, as EXR files have them.
LAYERS = {
    "depth": "Z", "depth_axis": "Z", "position": "XYZ", "normal": "XYZ", "geo_normal": "XYZ",
    "albedo": "RGB", "uv": "UV", "motion": "XY", "alpha": "A", "object": "I", "material": "I",
    "primitive": "I", "direct": "RGB", "indirect": "RGB",
}  # fmt: skip
NUMBERS = ("object", "material", "primitive")
PARTS = ("direct", "indirect")
#: What is made of nothing but the first surface.
OF_SURFACES = tuple(name for name in LAYERS if name not in PARTS)
#: Samples of a pixel, if nothing else is asked for, but not more than the picture has.
SPP = 8
_LIGHT = re.compile(r"light\.[A-Za-z0-9_-]{1,64}")


class Arrays(Mapping[str, Array]):
    """Arrays by name, each made when it is first asked for.

    what: the attribute that makes it, of sources that are no arrays; the same array each time.
    """

    def __init__(self, what: str, sources: Mapping[str, Any]) -> None:
        self._what, self._sources = what, dict(sources)

    def __getitem__(self, name: str) -> Array:
        source = self._sources[name]
        if not isinstance(source, np.ndarray):  # whose memory is given back once all is made
            source = self._sources[name] = getattr(source, self._what)
        made: Array = source
        return made

    def __iter__(self) -> Iterator[str]:
        return iter(self._sources)

    def __len__(self) -> int:
        return len(self._sources)

    def __contains__(self, name: object) -> bool:
        return name in self._sources

    def __repr__(self) -> str:
        return f"{type(self).__name__}({', '.join(self)})"

    def __getstate__(self) -> dict[str, Any]:
        return {"_what": self._what, "_sources": dict(self.items())}


class FeatureImages(Mapping[str, Array]):
    """Feature images by name.

    images: those of `veriray.features`. stderr: standard errors of the means among them, by name;
    0 where fewer than two samples met a surface. spp: samples of a pixel that the means are of.
    lamps: the lamps of each light group, by the image's name. motion_to: of the second camera of
    `motion`, (3, 4) float64: takes a point (x, y, z, 1) of the world to x w, y w and w, where x and
    y are its place on the film in pixels from the top left.

    What was rendered stays in memory of its device: each array is made when it is first asked for,
    and belongs to the caller.
    """

    def __init__(
        self, images: Mapping[str, Array] = {}, stderr: Mapping[str, Array] = {}, spp: int = 0,
        lamps: Mapping[str, Sequence[str]] = {}, motion_to: Array | None = None,
    ) -> None:  # fmt: skip
        for what, given in (("images", images), ("stderr", stderr)):
            if not isinstance(given, Mapping):
                raise ValueError(f"{what} = {shown(given)} is not a mapping of names to arrays")
            for name, values in given.items():
                known = isinstance(name, str) and _letters(name) and isinstance(values, np.ndarray)
                if not known or values.ndim < 2 or _channels(values) != len(_letters(name)):
                    raise ValueError(f"{what}: {shown(name)} is none of `veriray.features`")
        self.images, self.stderr = Arrays("image", images), Arrays("stderr", stderr)
        self.spp = whole("spp", spp, 0, 2**64 - 1, error=ValueError)
        if not isinstance(lamps, Mapping):
            raise ValueError(f"lamps = {shown(lamps)} is not a mapping of names to lists")
        self.lamps = {str(k): texts(f"lamps[{k}]", v, ValueError) for k, v in lamps.items()}
        if motion_to is not None:
            motion_to = array("motion_to", motion_to, np.float64, (3, 4))
        self.motion_to = motion_to

    @classmethod
    def _of(cls, images: Mapping[str, Any], means: Iterable[str], spp: int) -> FeatureImages:
        """Of objects with the attribute `image`, those of `means` with `stderr` too."""
        made = cls(spp=spp)
        made.images = Arrays("image", images)
        made.stderr = Arrays("stderr", {name: images[name] for name in means})
        return made

    def _add(self, name: str, part: Render, lamps: Sequence[str] = ()) -> None:
        """Takes a part of the picture."""
        self.images._sources[name] = self.stderr._sources[name] = part
        if lamps:
            self.lamps[name] = tuple(lamps)

    def __getitem__(self, name: str) -> Array:
        try:
            return self.images[name]
        except KeyError:
            raise KeyError(f"no feature image {name!r}; there are: {', '.join(self)}") from None

    def __iter__(self) -> Iterator[str]:
        return iter(self.images)

    def __len__(self) -> int:
        return len(self.images)

    def __contains__(self, name: object) -> bool:
        return name in self.images

    def __repr__(self) -> str:
        return f"FeatureImages({', '.join(self)}; {self.spp} spp)"

    def channels(self) -> dict[str, Array]:
        """(H, W) float32 or uint32 by the channel's name in an EXR file."""
        out: dict[str, Array] = {}
        for prefix, images in (("", self.images), ("stderr.", self.stderr)):
            for name, values in images.items():
                planes = values.reshape(*values.shape[:2], -1)
                for c, letter in enumerate(_letters(name)):
                    out[f"{prefix}{name}.{letter}"] = np.ascontiguousarray(planes[..., c])
        return out

    @classmethod
    def _of_channels(
        cls, channels: Mapping[str, Array], spp: int, lamps: Mapping[str, Sequence[str]],
        motion_to: Array | None,
    ) -> FeatureImages:  # fmt: skip
        """The inverse of `channels`, from all channels of a file."""
        found: dict[str, dict[str, Array]] = {"": {}, "stderr.": {}}
        lights = [name[:-2] for name in channels if name.endswith(".R") and _letters(name[:-2])]
        known = {**LAYERS, **{name: "RGB" for name in lights if name not in LAYERS}}
        for prefix, images in found.items():
            for name, letters in known.items():
                planes = [channels.get(f"{prefix}{name}.{letter}") for letter in letters]
                if all(plane is not None for plane in planes):
                    kind = np.uint32 if name in NUMBERS else np.float32
                    values = np.stack(planes, axis=-1).astype(kind)  # type: ignore[arg-type]
                    images[name] = values[..., 0] if len(letters) == 1 else values
        return cls(found[""], found["stderr."], spp, lamps, motion_to)

    def save(self, path: Any) -> None:
        """Write these images alone as an EXR file, whose channels are `channels()`.

        Raises ImageError for another suffix than .exr, OSError for what cannot be written.
        """
        from .saving import save_channels

        save_channels(path, self.channels(), self.attributes())

    def attributes(self) -> dict[str, str]:
        """Attributes of the header of an EXR file with these images."""
        if not self.images:
            return {}
        out = {"veriray.feature_spp": str(self.spp)}
        if self.lamps:
            out["veriray.light_groups"] = json.dumps(self.lamps)
        if self.motion_to is not None:
            out["veriray.motion_to"] = json.dumps(self.motion_to.tolist())
        return out


def _letters(name: str) -> str:
    """Letters of an image's channels; "" if there is no image of that name."""
    return LAYERS.get(name) or ("RGB" if _LIGHT.fullmatch(name) else "")


def _channels(values: Array) -> int:
    return values.shape[2] if values.ndim == 3 else 1


assert set(LAYERS) == set(FEATURES)
