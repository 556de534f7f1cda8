"""The surface that every native module has: `_cpu`, `_cpu_v3`, `_cpu_v4` and `_cuda`.

Lengths are world units. A GPU module has no `trace_path`; it alone has
`add_kernels`, `device_tree` and `intersect_width`. The modules live in one process side by
side, so their pybind11 types are module-local.
"""

from collections.abc import Callable, Mapping
from typing import Any, TypedDict

import numpy as np
import numpy.typing as npt

class DeviceError(RuntimeError): ...
class OutOfMemoryError(MemoryError): ...

class SceneArrays(TypedDict):
    """V vertices, T triangles, S spheres, D disks, M materials, E emissions, B boundaries, K
    media, Q lights, X textures, W texels, A attributes, Y sky, G grids, C cells, L lobes, P
    phase_values; see veriray.Scene. uint8 columns hold 0 or 1. Made by cpp/schema/generate.py
    from python/veriray/columns.py."""

    vertices: npt.NDArray[np.float64]  # (V, 3)
    normals: npt.NDArray[np.float64]  # (V, 3)
    triangles: npt.NDArray[np.uint32]  # (T, 3)
    triangle_material: npt.NDArray[np.uint32]  # (T,)
    triangle_emission: npt.NDArray[np.int32]  # (T,)
    triangle_boundary: npt.NDArray[np.int32]  # (T,)
    spheres: npt.NDArray[np.float64]  # (S, 4)
    sphere_material: npt.NDArray[np.uint32]  # (S,)
    sphere_emission: npt.NDArray[np.int32]  # (S,)
    sphere_boundary: npt.NDArray[np.int32]  # (S,)
    sphere_inward: npt.NDArray[np.uint8]  # (S,)
    disks: npt.NDArray[np.float64]  # (D, 3, 3)
    disk_material: npt.NDArray[np.uint32]  # (D,)
    disk_emission: npt.NDArray[np.int32]  # (D,)
    disk_boundary: npt.NDArray[np.int32]  # (D,)
    reflectance: npt.NDArray[np.float32]  # (M, 3)
    two_sided: npt.NDArray[np.uint8]  # (M,)
    material_kind: npt.NDArray[np.uint32]  # (M,)
    specular_reflectance: npt.NDArray[np.float32]  # (M, 3)
    specular_transmittance: npt.NDArray[np.float32]  # (M, 3)
    eta: npt.NDArray[np.float32]  # (M, 3)
    k: npt.NDArray[np.float32]  # (M, 3)
    opacity: npt.NDArray[np.float32]  # (M,)
    nonlinear: npt.NDArray[np.uint8]  # (M,)
    emissions: npt.NDArray[np.float32]  # (E, 3)
    environment: npt.NDArray[np.float32]  # (3,)
    boundaries: npt.NDArray[np.int32]  # (B, 2)
    sigma_t: npt.NDArray[np.float32]  # (K, 3)
    albedo: npt.NDArray[np.float32]  # (K, 3)
    phase_g: npt.NDArray[np.float32]  # (K,)
    light_kind: npt.NDArray[np.uint32]  # (Q,)
    light_position: npt.NDArray[np.float64]  # (Q, 3)
    light_direction: npt.NDArray[np.float64]  # (Q, 3)
    light_intensity: npt.NDArray[np.float32]  # (Q, 3)
    light_angles: npt.NDArray[np.float64]  # (Q, 2)
    uv: npt.NDArray[np.float32]  # (V, 2)
    sphere_frame: npt.NDArray[np.float32]  # (S, 3, 3)
    disk_turned: npt.NDArray[np.uint8]  # (D,)
    texture_kind: npt.NDArray[np.uint32]  # (X,)
    texture_to_uv: npt.NDArray[np.float32]  # (X, 2, 3)
    texture_color0: npt.NDArray[np.float32]  # (X, 3)
    texture_color1: npt.NDArray[np.float32]  # (X, 3)
    texture_field0: npt.NDArray[np.int32]  # (X,)
    texture_field1: npt.NDArray[np.int32]  # (X,)
    texture_wrap: npt.NDArray[np.uint32]  # (X,)
    texture_filter: npt.NDArray[np.uint32]  # (X,)
    texture_format: npt.NDArray[np.uint32]  # (X,)
    texture_width: npt.NDArray[np.uint32]  # (X,)
    texture_height: npt.NDArray[np.uint32]  # (X,)
    texture_depth: npt.NDArray[np.uint32]  # (X,)
    texture_to_world: npt.NDArray[np.float64]  # (X, 3, 4)
    texture_grey: npt.NDArray[np.uint8]  # (X,)
    texture_first: npt.NDArray[np.uint32]  # (X,)
    texels: npt.NDArray[np.uint32]  # (W,)
    attribute_values: npt.NDArray[np.float32]  # (A, 3)
    blend_material: npt.NDArray[np.int32]  # (M,)
    blend_weight: npt.NDArray[np.float32]  # (M,)
    blend_sides: npt.NDArray[np.uint8]  # (M,)
    reflectance_texture: npt.NDArray[np.int32]  # (M,)
    specular_reflectance_texture: npt.NDArray[np.int32]  # (M,)
    specular_transmittance_texture: npt.NDArray[np.int32]  # (M,)
    opacity_texture: npt.NDArray[np.int32]  # (M,)
    alpha_u_texture: npt.NDArray[np.int32]  # (M,)
    alpha_v_texture: npt.NDArray[np.int32]  # (M,)
    roughness_texture: npt.NDArray[np.int32]  # (M,)
    metallic_texture: npt.NDArray[np.int32]  # (M,)
    spec_trans_texture: npt.NDArray[np.int32]  # (M,)
    spec_tint_texture: npt.NDArray[np.int32]  # (M,)
    sheen_texture: npt.NDArray[np.int32]  # (M,)
    sheen_tint_texture: npt.NDArray[np.int32]  # (M,)
    flatness_texture: npt.NDArray[np.int32]  # (M,)
    clearcoat_texture: npt.NDArray[np.int32]  # (M,)
    clearcoat_gloss_texture: npt.NDArray[np.int32]  # (M,)
    anisotropic_texture: npt.NDArray[np.int32]  # (M,)
    diff_trans_texture: npt.NDArray[np.int32]  # (M,)
    blend_weight_texture: npt.NDArray[np.int32]  # (M,)
    eta_texture: npt.NDArray[np.int32]  # (M,)
    k_texture: npt.NDArray[np.int32]  # (M,)
    emission_texture: npt.NDArray[np.int32]  # (E,)
    light_texture: npt.NDArray[np.int32]  # (Q,)
    light_image: npt.NDArray[np.float64]  # (Q, 2, 3)
    alpha_u: npt.NDArray[np.float32]  # (M,)
    alpha_v: npt.NDArray[np.float32]  # (M,)
    distribution: npt.NDArray[np.uint32]  # (M,)
    shadowing: npt.NDArray[np.uint32]  # (M,)
    roughness: npt.NDArray[np.float32]  # (M,)
    metallic: npt.NDArray[np.float32]  # (M,)
    spec_trans: npt.NDArray[np.float32]  # (M,)
    spec_tint: npt.NDArray[np.float32]  # (M,)
    sheen: npt.NDArray[np.float32]  # (M,)
    sheen_tint: npt.NDArray[np.float32]  # (M,)
    flatness: npt.NDArray[np.float32]  # (M,)
    clearcoat: npt.NDArray[np.float32]  # (M,)
    clearcoat_gloss: npt.NDArray[np.float32]  # (M,)
    anisotropic: npt.NDArray[np.float32]  # (M,)
    diff_trans: npt.NDArray[np.float32]  # (M,)
    hair_along: npt.NDArray[np.float32]  # (M,)
    hair_around: npt.NDArray[np.float32]  # (M,)
    hair_tilt: npt.NDArray[np.float32]  # (M,)
    relief_texture: npt.NDArray[np.int32]  # (M,)
    relief_heights: npt.NDArray[np.uint8]  # (M,)
    relief_scale: npt.NDArray[np.float32]  # (M,)
    relief_flips: npt.NDArray[np.uint8]  # (M,)
    relief_shades: npt.NDArray[np.uint8]  # (M,)
    relief_mirrored: npt.NDArray[np.uint8]  # (M,)
    sky_texels: npt.NDArray[np.float32]  # (Y, 3)
    sky_size: npt.NDArray[np.uint32]  # (2,)
    sky_to_world: npt.NDArray[np.float64]  # (3, 3)
    sky_compensated: npt.NDArray[np.uint8]  # (1,)
    grid_size: npt.NDArray[np.uint32]  # (G, 3)
    grid_first: npt.NDArray[np.uint32]  # (G,)
    grid_grey: npt.NDArray[np.uint8]  # (G,)
    grid_wrap: npt.NDArray[np.uint32]  # (G,)
    grid_filter: npt.NDArray[np.uint32]  # (G,)
    grid_to_world: npt.NDArray[np.float64]  # (G, 3, 4)
    cells: npt.NDArray[np.float32]  # (C,)
    lobe_kind: npt.NDArray[np.uint32]  # (L,)
    lobe_share: npt.NDArray[np.float32]  # (L,)
    lobe_g: npt.NDArray[np.float32]  # (L,)
    lobe_flakes: npt.NDArray[np.float64]  # (L, 6)
    lobe_values: npt.NDArray[np.uint32]  # (L,)
    lobe_size: npt.NDArray[np.uint32]  # (L,)
    phase_values: npt.NDArray[np.float32]  # (P,)
    phase_lobe: npt.NDArray[np.int32]  # (K,)
    phase_lobes: npt.NDArray[np.uint32]  # (K,)
    albedo_grid: npt.NDArray[np.int32]  # (K,)
    sigma_t_grid: npt.NDArray[np.int32]  # (K,)
    emission_muted: npt.NDArray[np.uint8]  # (E,)
    light_muted: npt.NDArray[np.uint8]  # (Q,)
    sky_muted: npt.NDArray[np.uint8]  # (1,)
    muted_segments: npt.NDArray[np.uint32]  # (1,)

class CameraArguments(TypedDict):
    to_world: npt.NDArray[np.float64]
    parallel: bool  # then the tangents are half extents in world units
    tan_half_x: float
    tan_half_y: float
    near_clip: float
    far_clip: float
    principal_x: float
    principal_y: float
    aperture_radius: float
    focus_distance: float
    hides_light: bool  # lamps and sky are not there for camera rays
    medium: int
    patches: npt.NDArray[np.float64]  # (N, 11) as of Camera, of a camera at a surface
    distant: bool  # its rays go there

class FilmArguments(TypedDict):
    width: int
    height: int
    filter: str
    filter_parameters: tuple[float, float]  # unused ones are 0

class Report(TypedDict):
    """ledger (D, 9) uint64; blocks (D,) uint64; depth_seconds and compaction_seconds (D,) float64;
    trailing zero depths are left out, all but the ledger are empty where the scheduler has none."""

    ledger: npt.NDArray[np.uint64]
    blocks: npt.NDArray[np.uint64]
    depth_seconds: npt.NDArray[np.float64]
    compaction_seconds: npt.NDArray[np.float64]
    seconds: float
    nonfinite_samples: int
    nonfinite: list[tuple[int, int, int, float, float, float]]
    launches: int
    device: str
    scheduler: str
    features: list[str]
    threads: int
    path_bytes: int  # stored for a path in flight, in the variant that ran
    kernel: dict[str, int]  # registers local_bytes resident_threads; empty on the CPU

class Scene:
    """A scene as the back end keeps it. Raises ValueError, MemoryError, and what progress raises.

    progress: called with the share of the tree's build that is done. builder: sah or ploc."""

    def __init__(
        self,
        arrays: SceneArrays,
        camera: CameraArguments,
        film: FilmArguments,
        device: int = 0,
        progress: Callable[[float], object] | None = None,
        builder: str = "sah",
    ) -> None: ...
    # With other arrays (those that differ), another camera or film: shares what does not change;
    # None where the primitives change; a small scene is then made anew by `builder`, if that is
    # stated. The scene keeps its arrays, so they must stay as they are.
    def changed(
        self,
        arrays: Mapping[str, Any],
        camera: CameraArguments,
        film: FilmArguments,
        rough: bool = False,
        device: int = 0,
        builder: str = "",
    ) -> Scene | None: ...  # rough: the bits of its pictures may differ from those of one made anew
    # With a tree by another builder: shares the rest.
    def rebuilt(self, builder: str, progress: Callable[[float], object] | None = None) -> Scene: ...
    @property
    def family(self) -> int: ...  # the same for scenes that share primitives and tree
    @property
    def features(self) -> list[str]: ...  # what the scene needs
    @property
    def feature_mask(self) -> int: ...  # the same as bits
    @property
    def frame(self) -> tuple[tuple[float, float, float], float]: ...  # origin and unit of lengths
    @property
    def variant(self) -> list[str]: ...  # what the code chosen for it was compiled with
    @property
    def path_bytes(self) -> int: ...  # stored for a path in flight
    @property
    def input_index(self) -> npt.NDArray[np.uint32]: ...  # by primitive: triangle, T + sphere, ...
    @property
    def primitives(self) -> dict[str, int]: ...
    @property
    def lights(self) -> int: ...  # from which one is chosen
    @property
    def tree(self) -> dict[str, Any]: ...  # see veriray.render; or empty
    @property
    def memory(self) -> int: ...

class Plane(TypedDict):
    """A plane of a film, C channels a pixel. kind: "sums and squares", "sums" or "integers" (kept
    as sums). negative: samples below 0 are legitimate; of radiance the integrator decides."""

    name: str
    kind: str
    channels: int
    negative: bool

class PlaneState(Plane):
    """words: (H, W, C, 4 for sums and squares, else 2), row 0 on top: a 128-bit sum, its lower half
    first, then that of squares, of radiance those of units' sums over their samples; two's
    complement, of multiples of 2^-72 / scale, of squares 2^-76 / scale^2. scale: a power of two; 0
    where there are no samples yet, and of integers."""

    scale: float
    words: npt.NDArray[np.uint64]

class FilmState(TypedDict):
    """units: of the samples, independent of each other (`veriray.units`)."""

    samples: int
    units: int
    planes: list[PlaneState]

class Film:
    """Exact sums: any order and any split of the samples give the same bits.

    The first plane is radiance, sums and squares of three channels; `planes` come after it."""

    def __init__(
        self, width: int, height: int, device: int = 0, planes: list[Plane] = ...
    ) -> None: ...
    @property
    def samples(self) -> int: ...
    @property
    def units(self) -> int: ...  # as in FilmState
    @property
    def memory(self) -> int: ...
    @property
    def width(self) -> int: ...
    @property
    def height(self) -> int: ...
    def picture(
        self,
        counts: npt.NDArray[np.uint64] | None = None,  # samples by pixel, else `samples` of each
        threads: int = 0,
        plane: int = 0,  # one with squares
        units: bool = False,  # the counted samples are in units of `veriray.units.GROUP`
        tail: Film | None = None,  # the last group of each pixel that has not all of it
    ) -> Picture: ...
    def resolve(
        self, counts: npt.NDArray[np.uint64] | None = None, units: bool = False
    ) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]: ...
    def words(self, plane: int = 0) -> npt.NDArray[np.uint64]: ...  # as in PlaneState
    def sums(self) -> npt.NDArray[np.float64]: ...
    def add(self, other: Film) -> None: ...  # of the same device
    def end_unit(self, samples: int) -> None: ...  # all of radiance becomes one, of so many
    def state(self) -> FilmState: ...
    def add_state(self, state: FilmState) -> None:
        """Adds what a film of any device held, of the same size and planes; adds nothing where it
        raises ValueError. Samples of listed pixels are in the words, their number is the caller's.
        """

    def clear(self) -> None: ...

class Picture:
    """Means of a plane and their standard errors, (H, W, C) float32 each, in memory of its device.

    Of radiance C is 3. Of integers (H, W, C) uint32, and (H, W, 0) errors. What is made by size has
    no numbers before `put_features`."""

    def __init__(
        self, width: int, height: int, channels: int, integers: bool = False, device: int = 0
    ) -> None: ...
    @property
    def width(self) -> int: ...
    @property
    def height(self) -> int: ...
    @property
    def memory(self) -> int: ...
    @property
    def mean_stderr(
        self,
    ) -> float: ...  # the same on every device; NaN: one is not finite, features
    def image(self) -> npt.NDArray[Any]: ...  # a copy
    def stderr(self) -> npt.NDArray[np.float32]: ...  # a copy
    def view(self) -> npt.NDArray[np.float32]: ...  # of a CPU: the means themselves, read-only
    def pointer(self) -> int: ...  # of the means, in memory of the device
    def dlpack_device(self) -> tuple[int, int]: ...
    def dlpack(self, versioned: bool) -> Any: ...

def build_info() -> dict[str, Any]: ...
def status() -> tuple[bool, str]: ...
def variants() -> list[list[str]]: ...  # features of those compiled, smallest first
def path_bytes(features: list[str]) -> int: ...  # of a path in flight, in code that has these
def vertex_normals(
    vertices: npt.NDArray[np.float64],  # (V, 3), within [-1e100, 1e100]
    triangles: npt.NDArray[np.uint32],  # (T, 3)
) -> npt.NDArray[np.float64]: ...  # (V, 3), as veriray.formats.mesh
def read_obj(
    text: bytes,
) -> (
    tuple[
        npt.NDArray[np.float64],  # (V, 3)
        npt.NDArray[np.float64],  # (VT, 2)
        npt.NDArray[np.float64],  # (VN, 3)
        npt.NDArray[np.int64],  # (C, 3), rows of these, or -1
        npt.NDArray[np.int64],  # (F,), corners of each face
    ]
    | None
): ...  # None: as cpp/scene/obj_text.h
def read_rgbe(
    lines: bytes, width: int, height: int
) -> npt.NDArray[np.float32] | None: ...  # (height, width, 3); None: as cpp/scene/rgbe.h
def shading_of(
    vertices: npt.NDArray[np.float64],  # (V, 3)
    triangles: npt.NDArray[np.uint32],  # (T, 3)
    normals: npt.NDArray[np.float64],  # (V, 3)
) -> tuple[bool, bool]: ...  # some triangle's normals point to its back; all are the triangles'
def devices() -> list[dict[str, Any]]: ...
def render(
    scene: Scene,
    film: Film,
    *,
    seed: int,
    sample_begin: int,
    sample_end: int,
    max_depth: int,
    rr_depth: int,
    sampler: str,
    scheduler: str,
    threads: int,
    batch: int,
    all_features: bool,
    poll: Callable[[float], object] | None,
    pixels: npt.NDArray[np.uint32] | None = None,
    units: bool = False,  # squares are those of groups of samples (`veriray.units`)
) -> Report: ...
def render_features(
    scene: Scene,
    film: Film,
    *,
    seed: int,
    sample_begin: int,
    sample_end: int,
    sampler: str,
    threads: int,
    all_features: bool = False,
    first_row: int = 0,  # of the scene's, at which the film begins
    motion: npt.NDArray[np.float64],  # (2, 3, 4): veriray.first_surface.pixel_rows of two
    poll: Callable[[float], object] | None,
) -> dict[str, Any]:
    """Adds samples to the planes of a film that are feature images (cpp/film/features.h).

    Of these: sums and squares, negative ones too, in normalised lengths (`Scene.frame`); `hits`,
    which must be there, and `primitive`, integers. Returns seconds, nonfinite_samples, nonfinite
    and device. ValueError for a plane that is none."""

def put_features(
    scene: Scene,
    film: Film,
    *,
    pictures: list[Picture | None],  # by plane, without radiance; None: not wanted
    first_row: int,  # of the pictures, at which the film begins
    samples: int,  # those that `hits` is a share of
    threads: int = 0,
) -> None:
    """Puts the planes of a film of `render_features` into pictures, in units of the world.

    Means are over the samples that met something, depths without one infinite; of `hits` the share
    with its error, of `primitive` the integers. ValueError for a picture that does not fit."""

def trace_path(
    scene: Scene,
    *,
    seed: int,
    x: int,
    y: int,
    sample: int,
    max_depth: int,
    rr_depth: int,
    sampler: str,
) -> list[dict[str, Any]]: ...
def eval_function(name: str, x: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]: ...
def random(
    seed: int,
    pixel: npt.NDArray[np.uint32],
    sample: npt.NDArray[np.uint64],
    block: npt.NDArray[np.uint32],
    sampler: str = "independent",
) -> npt.NDArray[np.uint32]: ...
def add_values(
    film: Film,
    plane: str,
    scale: float,
    pixel: npt.NDArray[np.uint32],
    x: npt.NDArray[np.float32],  # (len(pixel), C)
) -> tuple[int, list[tuple[int, int, float, float, float]]]: ...  # refused: number, and some
def add_integers(
    film: Film, plane: str, pixel: npt.NDArray[np.uint32], x: npt.NDArray[np.uint64]
) -> None: ...
def intersect(
    scene: Scene, origins: npt.NDArray[np.float64], directions: npt.NDArray[np.float64]
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.int32]]: ...
def choose_lights(
    scene: Scene,
    points: npt.NDArray[np.float64],
    normals: npt.NDArray[np.float64],
    sides: npt.NDArray[np.uint32],  # 0: all, 1: the normal's, 2: both
    u24: npt.NDArray[np.uint32],
    row: npt.NDArray[np.uint32],
) -> tuple[npt.NDArray[np.uint32], npt.NDArray[np.float32], npt.NDArray[np.float32]]: ...
def light_tree(scene: Scene) -> tuple[npt.NDArray[np.float32], int]: ...  # (B, 16); root's branches
def count_leaks(
    scene: Scene, origins: npt.NDArray[np.float64], first: int, n: int
) -> tuple[int, int]: ...
def host_ploc(
    scene: Scene, width: int, threads: int = 0
) -> tuple[npt.NDArray[np.uint32], npt.NDArray[np.uint32]]: ...
def add_kernels(device: int, features: int, code: bytes) -> None: ...  # see veriray.kernels
def device_tree(scene: Scene) -> tuple[npt.NDArray[np.uint32], npt.NDArray[np.uint32]]: ...
def intersect_width(
    scene: Scene,
    width: int,
    origins: npt.NDArray[np.float64],
    directions: npt.NDArray[np.float64],
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.int32], float]: ...
