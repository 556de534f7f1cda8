"""From a tree to a scene: checks every object against `plugins`, then makes the arrays."""

from __future__ import annotations

import itertools
import math
import warnings
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from .. import transform
from ..camera import Camera
from ..columns import COLUMNS, LIGHT_KINDS, MATERIAL_KINDS, OPAQUE_KINDS, TABLES, blank_row
from ..errors import SceneError, SceneWarning
from ..named import Object, Objects, Use
from ..numeric import check_rigid, tan_half_degrees
from . import fibres, integrators, materials, meters, phases, textures, views, volumes
from .curves import KINDS
from .node import Node, Ref, Tree, allowed, shorten
from .plugins import COLOUR, PLUGINS, RELIEFS, SHUTTER
from .report import Full, Listed, Report
from .sensors import Sensors, field_of_view, shutter
from .shapes import IDENTITY, Shapes, Surface, must_be_closed
from .skies import envmap
from .sunsky import sunsky
from .textures import Attribute
from .timed_sky import timed_sunsky
from .values import check, located

Array = npt.NDArray[Any]
_Parts = dict[str, list[Node]]


#: Categories of objects that Mitsuba takes in a scene, too, where they have no effect.
_IDLE = ("film", "sampler", "rfilter", "phase")


@dataclass(frozen=True)
class Built:
    """The arguments of a Scene, where in the file the rows of its tables come from, the cameras of
    all sensors, notes on what has no effect, which rows its objects became, the feature images that
    the file asks for, and place and text of what is rendered with other numbers."""

    arguments: dict[str, Any]
    places: dict[str, list[str]]
    cameras: tuple[Camera, ...]
    notes: tuple[str, ...]
    objects: Objects
    features: tuple[str, ...]
    warned: tuple[tuple[str, str], ...]


def build(read: Callable[[Report], Tree], sensor: int | None = None, strict: bool = False) -> Built:
    """The scene of the tree that `read` gives, seen by its sensor of that number, else the first.

    Raises SceneError naming place, object, key, value and what is allowed, of all faults that there
    are; warns (SceneWarning) of a scene without light. strict: notes are faults.
    """
    report = Report(strict)
    try:
        tree = read(report)
        if not report.faults:
            try:
                built = _Builder(tree, sensor).scene()
            except SceneError as error:
                report.add(error)
            if not report.faults:
                return built
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", SceneWarning)
            _Builder(tree, sensor).search()
    except Full:
        pass
    report.fail()


class _Builder:
    def __init__(self, tree: Tree, sensor: int | None) -> None:
        self.tree = tree
        self.report = tree.report
        self.sensor_index = sensor
        self.checked: dict[int, tuple[Node, _Parts, dict[str, Any]]] = {}
        self.childless: dict[str, _Parts] = {}
        self.rows: dict[int, materials.Row] = {}
        self.around: set[int] = set()  # bsdfs that hold the one of which a row is made
        self.groups: dict[int, list[Surface]] = {}
        self.sensors = Sensors(
            self.report, tree.ids, self.check, self.resolve, self.medium, self.boundary
        )
        self.tables = _Tables()
        self.texels = textures.Texels(self.report)
        self.grids = volumes.Grids()
        self.phase_values: list[float] = []
        self.media: list[tuple[Node, bool]] = []  # used, and whether their extinction is coloured
        #: copies of textures whose numbers may be up to another than 1, by that, and of
        #: checkerboards that give one number
        self.larger: dict[float, dict[int, tuple[Node, Node]]] = {}
        self.exchanged: dict[int, tuple[Node, Node]] = {}
        self.inverted: dict[int, tuple[Node, Node]] = {}  # and where 1 less that counts
        self.sky: dict[str, Any] = {}
        self.beams: Node | None = None  # the first directionalarea
        self.hides = False  # emitters, those too that emit nothing
        self.beyond: dict[int, volumes.Grid] = {}  # by medium: of version 0.x
        #: materials that have textures: what they read from meshes
        self.textured: dict[int, list[Attribute]] = {}
        self.textured_lamps: dict[int, list[Attribute]] = {}  # emissions, likewise
        self.with_texture: set[int] = set()  # their nodes by id, kept by `checked`
        items: list[Any] = tree.scene.children
        known = [tree.ids.get(i.id) if type(i) is Ref else i for i in items]
        if "timed_sunsky" in [node.plugin for node in known if node is not None]:
            self.report.used = SHUTTER

    def search(self) -> None:
        """Puts all faults into the report that can be found."""
        nodes, todo = [], [*reversed(self.tree.orphans), self.tree.scene]
        while todo:
            node = todo.pop()
            nodes.append(node)
            todo += [item for item in reversed(node.children) if isinstance(item, Node)]
        known = [node for node in nodes if node.plugin]
        for node in known:
            self.attempt(self.children, node, True)
            self.attempt(check, node, self.report, every=True)
        shapes = Shapes(self.textured, self.textured_lamps)
        for node in known:
            if node.category == "shape":
                self.sensors.meters.add(node, self.tree.ids)
        for node in known:
            if node.category == "bsdf":
                self.attempt(self.material, node)
            elif node.category == "medium":
                self.attempt(self.check_medium, node)
            elif node.category == "sensor":
                self.attempt(self.sensors.seen_by, node)
            elif node.category == "integrator":
                self.attempt(integrators.depths, node, self.check, self.report)
            elif node.category == "shape" and "shape" not in PLUGINS[node.plugin].children:
                self.attempt(self.shape, node, shapes)
            elif node.category == "emitter" and node.plugin in LIGHT_KINDS:
                self.attempt(self.light, node)

    def attempt(self, make: Callable[..., object], *arguments: Any, **options: Any) -> None:
        """make(*arguments, **options); its SceneError goes to the report."""
        try:
            make(*arguments, **options)
        except SceneError as error:
            self.report.add(error)

    def check(self, node: Node) -> tuple[_Parts, dict[str, Any]]:
        """A node's objects and parameters, checked once however often it is used."""
        found = self.checked.get(id(node))
        if found is None:  # holding the node keeps its id unique
            values = check(node, self.report)
            found = self.checked[id(node)] = node, self.children(node), values
        return found[1:]

    def children(self, node: Node, every: bool = False) -> _Parts:
        """A node's objects by category, references resolved, kinds and numbers checked.

        every: the report takes all faults, instead of the first being raised.
        """
        if not node.children and not node.faulty and node.plugin in self.childless:
            return self.childless[node.plugin]
        rules = PLUGINS[node.plugin].children
        result: _Parts = {category: [] for category in rules}
        faulty = node.faulty
        for item in self.items(node):
            try:
                child = self.child(item, node)
            except SceneError as error:
                if not every:
                    raise
                self.report.add(error)
                faulty = True
            else:
                if child.plugin in rules.get(child.category, ((),))[0]:  # else without effect, or a
                    result[child.category].append(child)  # texture, which is a parameter's value
        for category, (names_, fewest, most) in rules.items():
            found = result[category]
            if len(found) < fewest and not faulty:
                what = f"{len(found)} of the {fewest} {category}s that it needs"
                what = what if found else f"no {category}"
                raise SceneError(f"{node} has {what}; allowed: {', '.join(names_)}", node.where)
            if len(found) > most:
                raise SceneError(
                    f"{node} has {len(found)} objects of category {category}, at most {most} "
                    "allowed",
                    found[most].where,
                )
        if faulty:
            raise Listed("")
        if not node.children:
            self.childless[node.plugin] = result
        return result

    def items(self, node: Node) -> list[Node | Ref]:
        """What a node holds; of the scene without references to what it holds already."""
        if node.category != "scene" or Ref not in map(type, node.children):
            return node.children
        held = {id(item) for item in node.children}
        result: list[Node | Ref] = []
        for item in node.children:
            child = self.tree.ids.get(item.id) if isinstance(item, Ref) else None
            if child is not None and id(child) in held:
                text = f"{shorten(item.id)} is a part of the scene already; it counts once"
                self.report.note(f"ref: {text}", item.where)
                continue
            held.add(id(child))
            result.append(item)
        return result

    def child(self, item: Node | Ref, node: Node) -> Node:
        """What an object of `node` is, checked for its kind."""
        child = self.resolve(item, node) if isinstance(item, Ref) else item
        if not child.plugin:
            raise Listed("")
        rules = PLUGINS[node.plugin].children
        if child.category == "texture" and item.name in PLUGINS[node.plugin].noted:
            text = f'{node}: "{item.name}": {PLUGINS[node.plugin].noted[item.name]}'
            self.report.note(text, item.where)
        elif child.category == "texture" and node.category != "scene":
            textures.check_place(node, child, item)
        elif node.category == "scene" and (
            child.category in _IDLE or child.plugin in ("area", "directionalarea")
        ):
            self.report.note(f"{child}: in no object, it has no effect", item.where)
        elif child.category not in rules or child.plugin not in rules[child.category][0]:
            names = [name for allowed_names, _, _ in rules.values() for name in allowed_names]
            raise SceneError(
                f"{node} cannot hold a {child.category} {shorten(child.plugin)}"
                + allowed(child.plugin, names),
                item.where,
            )
        return child

    def resolve(self, ref: Ref, node: Node) -> Node:
        if ref.id not in self.tree.ids:
            raise SceneError(
                f"{node}: there is no object with the id {shorten(ref.id)}"
                + allowed(ref.id, self.tree.ids, "known"),
                ref.where,
            )
        return self.tree.ids[ref.id]

    def scene(self) -> Built:
        root = self.tree.scene
        parts, _ = self.check(root)
        integrator = parts["integrator"][0] if parts["integrator"] else Node("path", root.where)
        depths = integrators.depths(integrator, self.check, self.report)
        self.hides = bool(depths["hide_emitters"])
        self.sensors.meters = meters.of_scene(self.items(root), self.tree.ids)
        sensors = self.sensors.meters.nodes
        of_each = [self.sensors.seen_by(node) for node in sensors]
        seen_by = [view for one in of_each for view in one]
        chosen = self.chosen(sensors, max(len(seen_by), 1))
        environment = self.lights(parts["emitter"])
        for bsdf in parts["bsdf"]:
            self.material(bsdf)
        for medium in parts["medium"]:
            self.check_medium(medium)
        for plain in (*parts["texture"], *parts["volume"]):
            self.check(plain)
        shapes = Shapes(self.textured, self.textured_lamps, self.shared_files())
        for shape in parts["shape"]:
            self.shape(shape, shapes)
        for text, place in shapes.notes():
            self.report.note(text, place)
        textured = bool(self.tables.rows["textures"] or self.textured)
        shown = shapes.arrays(with_uv=textured)
        shown |= self.attributes(shapes, shown)
        arrays = {**self.tables.arrays(), **shown, **self.sky}
        arrays["texels"] = self.texels.array()
        arrays["cells"] = self.grids.array()
        arrays["phase_values"] = self.phase_values or None
        seen = arrays["emissions"] is not None or bool(self.sky) or any(environment)
        if not seen and arrays["light_kind"] is None:
            warnings.warn(
                f"{root.where}: the scene has no light: the picture will be black",
                SceneWarning,
                stacklevel=4,
            )
        stated = bool(parts["integrator"])
        integrators.check_scene(
            integrator, self.check, self.report, seen, arrays, self.beams, stated
        )
        for node, coloured in self.media:
            integrators.check_medium(node, coloured, self.report, arrays["light_kind"] is not None)
        features = self.report.features
        if "uv" in features and not textured:
            features = tuple(name for name in features if name != "uv")
            self.report.note(f"{integrator}: nothing is textured, so uv is not written",
                             integrator.where)  # fmt: skip
        for node, one in zip(sensors, of_each, strict=True):
            if node.plugin == "irradiancemeter" and arrays["light_kind"] is not None:
                self.report.note(
                    f"{node}: without the direct light of points, spots and parallel lights, which "
                    "no ray meets; nor is it in Mitsuba's",
                    node.where,
                )
            if node.plugin == "distant":
                one[:] = [(self.sensors.far(node, views.ball(arrays)), *one[0][1:])]
        seen_by = [view for one in of_each for view in one]
        if not seen_by:
            seen_by = [
                self.sensors.view(Node("perspective", root.where), views.framing(arrays, root))
            ]
            self.report.note("the scene has no sensor; one was placed that frames it", root.where)
        camera, film, sampling = seen_by[chosen]
        arguments = {
            **arrays,
            **shapes.fresh(arrays),
            "environment": np.array(environment),
            "camera": camera,
            "film": film,
            **depths,
            **sampling,
        }
        places = {"scene": [root.where], "shapes": shapes.places}
        return Built(
            arguments,
            {**places, **self.tables.places()},
            tuple(camera for camera, _, _ in seen_by),
            tuple(self.report.notes),
            self.tables.objects(),
            features,
            tuple(self.report.warned),
        )

    def shared_files(self) -> set[str]:
        """The names of files that several objects of the scene have."""
        names: Counter[str] = Counter()
        todo: list[Node | Ref] = [self.tree.scene]
        while todo:
            node = todo.pop()
            if isinstance(node, Node):
                todo += node.children
                given = node.values.get("filename")
                if given is not None and isinstance(given.value, str):
                    names[given.value] += 1
        return {name for name, count in names.items() if count > 1}

    def attributes(self, shapes: Shapes, shown: dict[str, Any]) -> dict[str, Any]:
        """The column of attributes; also writes where those of each texture begin."""
        first: dict[tuple[str, float, float, bool], int] = {}
        blocks: list[Array] = []
        for _, _, row in self.tables.rows["textures"].values():
            attribute = row.get("attribute")
            if attribute is None:
                continue
            key = attribute.key
            if key not in first:
                first[key] = sum(map(len, blocks))
                of = "vertices" if attribute.name.startswith("vertex_") else "triangles"
                blocks.append(shapes.attribute(key, len(shown[of])))
            row["texture_first"] = first[key]
        for text, place in shapes.warned:
            self.report.warn(text, place)
        return {"attribute_values": np.concatenate(blocks) if blocks else None}

    def chosen(self, sensors: list[Node], count: int) -> int:
        """The number of the sensor to render, of `count`."""
        number = self.sensor_index
        if number is None:
            if count > 1:
                text = f"the first of {count} sensors is rendered; sensor = N takes another"
                self.report.note(text, sensors[0].where)
            return 0
        if not 0 <= number < count:
            raise SceneError(
                f"sensor = {number} is outside [0, {count - 1}]", self.tree.scene.where
            )
        return number

    def lights(self, nodes: list[Node]) -> tuple[float, ...]:
        """Adds the lights that are not on shapes; returns the environment's radiance."""
        skies = [node for node in nodes if node.plugin in _SKIES]
        if len(skies) > 1:
            raise SceneError(
                f"a second emitter {skies[1].plugin}; at most 1 allowed of {' and '.join(_SKIES)}",
                skies[1].where,
            )
        for node in nodes:
            if node.plugin not in _SKIES:
                self.light(node)
        if not skies:
            return 0.0, 0.0, 0.0
        _, values = self.check(skies[0])
        if skies[0].plugin == "constant":
            return tuple(values["radiance"])
        self.unscaled(skies[0], values)
        if skies[0].plugin == "timed_sunsky":
            held = self.check(self.tree.scene)[0]["sensor"][self.sensor_index or 0 :][:1]
            self.sky = timed_sunsky(skies[0], values, shutter(held), self.report)
        else:
            made = envmap if skies[0].plugin == "envmap" else sunsky
            self.sky = made(skies[0], values, self.report)
        return 0.0, 0.0, 0.0

    def material(self, node: Node) -> materials.Row:
        """The row of a bsdf, made once."""
        parts, values = self.check(node)  # holds the node, and so its id
        row = self.rows.get(id(node))
        if row is None:
            if id(node) in self.around:
                raise SceneError(f"{node} holds itself", node.where)
            self.around.add(id(node))
            try:
                held = [self.material(part) for part in parts.get("bsdf", ())]
            finally:
                self.around.remove(id(node))
            # of a blend as the first of two the other comes first, by the rest of the weight
            swaps = node.plugin == "blendbsdf" and ["other" in one for one in held] == [True, False]
            given = {} if node.plugin in RELIEFS else self.textures(node, swaps)
            if node.plugin == "twosided":
                held = [materials.front(one) for one in held]
                row = materials.two_sided(held[0])
                if held[1:] and held[1] is not held[0]:
                    row = materials.of_sides(held[0], (parts["bsdf"][1], held[1]))
                if any(map(_lets_through, materials.both(row))):
                    raise SceneError(
                        f"{node} cannot hold a {parts['bsdf'][0].plugin} that lets light through",
                        parts["bsdf"][0].where,
                    )
            elif node.plugin == "mask":
                inside = materials.both(held[0])
                shares = not given and all(one.get("opacity_texture", -1) < 0 for one in inside)
                if any(map(_masked, inside)) and not shares:
                    what = parts["bsdf"][0].plugin
                    what = what if what == "mask" else f"{what} of masks"
                    raise SceneError(
                        f"{node} cannot hold a {what}, unless numbers are the opacity of all",
                        parts["bsdf"][0].where,
                    )
                row = materials.masked(held[0], {**materials.filled(node, values), **given}, node)
            elif node.plugin == "blendbsdf":
                row = materials.blend(node, values, parts["bsdf"], held, given)
            elif node.plugin in RELIEFS:
                if any(one.get("relief_texture", -1) >= 0 for one in materials.both(held[0])):
                    text = f"{node} cannot hold another map; one map to a material"
                    raise SceneError(text, parts["bsdf"][0].where)
                row = materials.changed(
                    held[0], {**materials.filled(node, values), **self.relief(node, values)}
                )
            elif node.plugin == "hair":
                row = fibres.row(node, values)
                row |= {"blend_sides": True, "other": (replace(node), fibres.INSIDE), "bsdf": node}
            else:
                row = {**materials.material(node, values, self.report), **given, "bsdf": node}
            if held and node.id:
                row = materials.held_by(row, node.id)
            row["attributes"] = [
                attribute for one in (*held, given) for attribute in one.get("attributes", ())
            ]
            if any(map(materials.reads_uv, materials.both(row))):
                self.with_texture.add(id(node))
            self.rows[id(node)] = row
        return row

    def textures(self, node: Node, inverse: bool = False) -> materials.Row:
        """The columns that name the textures of a bsdf; inverse: of 1 less what they give."""
        columns: materials.Row = {}
        rows: materials.Row = {}
        attributes: list[Attribute] = []
        for item in node.children:
            child = self.resolve(item, node) if isinstance(item, Ref) else item
            if child.category != "texture":
                continue
            if item.name in PLUGINS[node.plugin].noted:
                continue
            column = f"{PLUGINS[node.plugin].params[item.name].column}_texture"
            if item.name in node.values or column in columns:
                raise SceneError(f'{node}: "{item.name}" is given twice', item.where)
            param = PLUGINS[node.plugin].params[item.name]
            number, most = param.kind != COLOUR, COLUMNS[param.column].high
            if most != 1:
                child = self.up_to(most, child)
            if inverse:
                child = self.copy(self.inverted, child, exchange=True)
            elif number and child.plugin == "checkerboard":
                child = self.copy(self.exchanged, child, exchange=True)
            rows[item.name], found = self.texture(child, most, number, inverse)
            for attribute in found:
                attribute.single = item.where if number else attribute.single
            attributes += found
            columns[column] = self.tables.index("textures", child, rows[item.name])
        columns |= materials.textured_alpha(columns, rows)
        return {**columns, "attributes": attributes} if attributes else columns

    def texture(
        self,
        node: Node,
        most: float = 1.0,
        number: bool = False,
        inverse: bool = False,
        depth: int = 0,
    ) -> tuple[materials.Row, list[Attribute]]:
        """The row of a texture, after those of the textures in it, and what all of them read from
        meshes; most: as of `Texels.row`. number: one is wanted, which of a colour is the mean, as
        in Mitsuba, but of a texel the luminance; inverse: 1 less that."""
        textures.check_depth(node, depth)
        parts, values = self.check(node)
        if node.plugin == "volume":
            values = self.volume(parts["volume"][0])
        known = id(node) in self.texels.rows
        row = self.texels.row(node, values, most=most, inverse=inverse)
        if number:
            row["form"] = "rest" if inverse else "mean"
            row["exchanged"] = not textures.in_order(node)
        for name in ("texture_color0", "texture_color1"):
            if number and name in row and not known:
                mean = sum(row[name]) / 3
                row[name] = (1 - mean if inverse else mean,) * 3
        found = [row["attribute"]] if "attribute" in row else []
        for name, child in textures.textures_in(node, self.resolve).items():
            inside, attributes = self.texture(child, most, number, inverse, depth + 1)
            field = PLUGINS[node.plugin].params[name].field
            row[field] = self.tables.index("textures", child, inside)
            found += attributes
        return row, found

    def volume(self, volume: Node) -> dict[str, Any]:
        """What a texture reads of a volume."""
        values = self.check(volume)[1]
        if volume.plugin == "constvolume":
            return {"value": values["color"] or values["value"], "where": volume.where}
        cells, matrix = self.grids.cells(volume, values, "a texture")
        return {**values, "cells": cells, "matrix": matrix, "where": volume.where}

    def copy(self, known: dict[int, tuple[Node, Node]], node: Node, exchange: bool) -> Node:
        """A texture's node and those in it once more, made once."""
        if id(node) not in known:  # holds the node, and so its id
            known[id(node)] = node, textures.copied(node, self.resolve, exchange)
        return known[id(node)][1]

    def relief(self, node: Node, values: dict[str, Any]) -> materials.Row:
        """The columns of the texture that turns normals; a colour is a texture of equal parts."""
        found = [self.resolve(item, node) if isinstance(item, Ref) else item
                 for item in node.children]  # fmt: skip
        found = [child for child in found if child.category == "texture"]
        even = values.get("normalmap")
        if even is not None and not found:
            row = textures.even(even)  # of a node of its own, as the id is the material's
            return {"relief_texture": self.tables.index("textures", replace(node, id=""), row)}
        if len(found) != 1 or even is not None:
            one = " besides a colour" if even is not None else ""
            raise SceneError(
                f"{node} has {len(found)} textures{one}, expected 1, a bitmap", node.where
            )
        heights = node.plugin == "bumpmap"
        most = math.inf if heights else 1.0
        child = self.up_to(most, found[0]) if heights else found[0]
        row = self.texels.row(child, self.check(child)[1], most=most)
        if row["texture_grey"] and not heights:
            raise SceneError(f"{node}: a grey image holds no normals", child.where)
        texture = self.tables.index("textures", child, row)
        return {"relief_texture": texture, "relief_heights": heights}

    def medium(self, node: Node) -> int:
        """Index of a medium, which gets a row when it is first used."""
        row, grids, lobes = self.check_medium(node)
        new = len(self.tables.rows["media"])
        index = self.tables.index("media", node, row)
        if index < new:
            return index
        coloured = len(set(row["sigma_t"])) > 1
        if "sigma_t" in grids:
            coloured |= grids["sigma_t"].cells.shape[3] > 1
            if grids["sigma_t"].beyond():
                self.beyond[index] = grids["sigma_t"]
        self.media.append((node, coloured))
        for name, grid in grids.items():
            row[f"{name}_grid"] = self.tables.index("grids", grid.node, self.grids.placed(grid))
        for lobe, of_lobe, values in lobes:
            of_lobe["lobe_values"] = len(self.phase_values)
            self.phase_values += values
            place = self.tables.index("lobes", lobe, of_lobe)
            row.setdefault("phase_lobe", place)
            row["phase_lobes"] = len(lobes)
        return index

    def check_beyond(self, node: Node, values: dict[str, Any], media: tuple[int, int]) -> None:
        """Tells of grids of version 0.x that a shape shows beyond their box."""
        text = "the medium half a cell beyond its box is as at the box's edge, but was empty in "
        for side, medium in enumerate(media):
            grid = self.beyond.get(medium)
            if grid is None:
                continue
            corners = None if side else _hull(node, values)
            if corners is None and not side:
                told = f"gridvolume: {text}version 0.x; it counts where its shape is larger"
                self.report.note(told, grid.node.where)
            elif corners is None or grid.reached(corners):
                told = f"gridvolume: {text}version 0.x; its shape {node} reaches there"
                self.report.warn(told, grid.node.where)

    def check_medium(
        self, node: Node
    ) -> tuple[materials.Row, dict[str, volumes.Grid], list[phases.Lobe]]:
        """A medium's row, the grids of its parameters, and the lobes of its phase function if that
        is not Henyey and Greenstein's."""
        parts, values = self.check(node)
        filled: materials.Row = {}
        lobes: list[phases.Lobe] = []
        area = 1.0
        for phase in parts["phase"]:
            if phase.plugin in ("isotropic", "hg"):
                filled = materials.filled(phase, self.check(phase)[1])
            else:
                lobes, area = phases.lobes(phase, self.check, self.numbers)
        given = "scale" if values.get("density_scale") is None else "density_scale"
        values = {**values, given: values[given] * area}
        return *volumes.medium(node, values, filled, self.volumes(node), self.grids), lobes

    def numbers(self, node: Node, count: int, name: str) -> list[float] | None:
        """So many numbers of a phase function's volume, if they are the same everywhere."""
        given = self.volumes(node, (name,)).get(name)
        return None if given is None else self.grids.numbers_of(*given, count, name)

    def volumes(self, node: Node, names: tuple[str, ...] = ("albedo", "sigma_t")) -> volumes.Given:
        """The volumes of a medium or phase function by the parameter that they give."""
        given: volumes.Given = {}
        for item in node.children:
            child = self.resolve(item, node) if isinstance(item, Ref) else item
            if child.category != "volume":
                continue
            if item.name not in names:
                raise SceneError(
                    f"{node}: a volume of a {node.category} is named {shorten(item.name)}"
                    + allowed(item.name, names),
                    item.where,
                )
            if item.name in given or item.name in node.values:
                raise SceneError(f'{node}: "{item.name}" is given twice', item.where)
            given[item.name] = child, self.check(child)[1]
        return given

    def boundary(self, node: Node) -> tuple[int, int]:
        """The media inside and outside of a shape, -1 for vacuum."""
        media: dict[str, int] = {}
        for item in node.children:
            child = self.resolve(item, node) if isinstance(item, Ref) else item
            if child.category != "medium":
                continue
            if item.name not in ("interior", "exterior"):
                raise SceneError(
                    f"{node}: a medium of a shape is named {shorten(item.name)}"
                    + allowed(item.name, ("interior", "exterior")),
                    item.where,
                )
            if item.name in media:
                raise SceneError(f"{node}: two media are named {item.name}", item.where)
            media[item.name] = self.medium(child)
        return media.get("interior", -1), media.get("exterior", -1)

    def shape(self, node: Node, shapes: Shapes) -> None:
        """Adds a shape; the ones of a group are added by its instances."""
        if node.plugin == "shapegroup":
            self.group(node)
        elif node.plugin == "instance":
            values, parts = check(node, self.report), self.children(node)
            shapes.instance(node, values["to_world"], self.group(parts["shape"][0]))
        elif node.plugin == "merge":
            check(node)
            for child in self.children(node)["shape"]:
                self.shape(child, shapes)
        else:
            shapes.add(self.surface(node))

    def group(self, node: Node) -> list[Surface]:
        """The shapes of a group, or of a merge in one."""
        found = self.groups.get(id(node))
        if found is None:
            found = []
            for child in self.check(node)[0]["shape"]:  # holds the node, and so its id
                if child.plugin == "instance":
                    raise SceneError(f"{node}: a group cannot hold an instance", child.where)
                found += self.group(child) if child.plugin == "merge" else [self.surface(child)]
            self.groups[id(node)] = found
        return found

    def surface(self, node: Node) -> Surface:
        """A shape with the rows of its material, emission and boundary."""
        values, parts = check(node, self.report), self.children(node)  # used once
        for sensor in parts["sensor"]:
            self.sensors.meters.of(sensor)
        lamp = parts["emitter"][0] if parts["emitter"] else None
        if parts["bsdf"]:
            bsdf, row = parts["bsdf"][0], self.material(parts["bsdf"][0])
        else:  # as Mitsuba: a lamp reflects nothing
            bsdf = _LAMP if lamp else _GREY
            row = materials.BLACK if lamp else self.material(bsdf)
        material = self.tables.index("materials", bsdf, row)
        if bsdf.plugin == "hair" and node.plugin not in KINDS:
            text = f"{node}: hair is for curves; on a {node.plugin} light from within passes"
            self.report.warn(f"{text}, which Mitsuba scatters once more", bsdf.where)
        if bsdf.plugin == "hair" and node.plugin == "linearcurve":
            text = (
                f"{node}: hair lies along the curve; in Mitsuba its direction is the normal's alone"
            )
            self.report.warn(text, bsdf.where)
        inside = row
        while "other" in inside:
            inside["blend_material"] = self.tables.index("materials", *inside["other"])
            inside = inside["other"][1]
        if id(bsdf) in self.with_texture:
            self.textured[material] = row["attributes"]
        emission = boundary = -1
        if lamp:
            radiance = self.check(lamp)[1]["radiance"]
            if lamp.plugin == "directionalarea":
                self.beams, radiance = self.beams or lamp, (0.0, 0.0, 0.0)
            if _shines(radiance) or self.hides:
                image, _, attributes = self.light_texture(lamp, "radiance")
                shines = {"emissions": radiance, "emission_texture": image}
                emission = self.tables.index("emissions", lamp, shines)
                if image >= 0:
                    self.textured_lamps[emission] = attributes
        media = self.boundary(node)
        if media != (-1, -1):
            boundary = self.tables.index("boundaries", media, {"boundaries": media})
        if values["to_world"] is None:
            values["to_world"] = IDENTITY
        if self.beyond:
            self.check_beyond(node, values, media)
        solid = (must_be_closed(one, media[0] >= 0) for one in materials.both(row))
        return node, values, (material, emission, boundary), next(filter(None, solid), "")

    def light(self, node: Node) -> None:
        """Adds a light that is not on a shape."""
        _, values = self.check(node)
        if values["sampling_weight"] == 0:
            text = f"{node}: by sampling_weight 0 it is never sampled: no light, as in Mitsuba"
            self.report.warn(text, node.values["sampling_weight"].where)
            return
        row = {"light_kind": LIGHT_KINDS.index(node.plugin), **materials.filled(node, values)}
        if node.plugin == "projector":
            colour = values["irradiance"] or (1.0, 1.0, 1.0)
            row["light_intensity"] = tuple(math.pi * values["scale"] * x for x in colour)
        if not _shines(row["light_intensity"]):
            return
        if node.plugin in ("spot", "projector"):
            self.unscaled(node, values)
        matrix = np.eye(4) if values["to_world"] is None else values["to_world"]
        other = {"point": "position", "directional": "direction"}.get(node.plugin, "")
        given = values.get(other)
        if given is not None and values["to_world"] is not None:
            raise SceneError(f"{node}: both {other} and to_world given", node.where)
        if node.plugin != "directional":
            row["light_position"] = matrix[:3, 3].tolist()
        if node.plugin != "point":
            ahead = matrix[:3, 2].tolist() if given is None else given
            row["light_direction"] = transform.unit(
                ahead, f"{node}: direction has length 0", node.where
            )
        elif given is not None:
            row["light_position"] = given
        if node.plugin in ("spot", "projector"):
            what = f"a {node.plugin} may be scaled evenly, which is left out; else it"
            located(node, lambda: check_rigid(f"{node} to_world", what, matrix))
        if node.plugin == "spot":
            cutoff, beam = values["cutoff_angle"], values["beam_width"]
            beam = 0.75 * cutoff if beam is None else beam
            if not 0 < cutoff:
                text = f"{node}: cutoff_angle = {cutoff:g}, expected more than 0"
                raise SceneError(text, node.where)
            if beam > cutoff:
                text = f"{node}: beam_width = {beam:g} is rendered as cutoff_angle = {cutoff:g}"
                self.report.warn(text, node.values["beam_width"].where)
                beam = cutoff
            row["light_angles"] = cutoff, beam
            row |= self.spot_image(node, values, matrix)
        elif node.plugin == "projector":
            row |= self.projector_image(node, values, matrix)
        self.tables.index("lights", node, row)

    def unscaled(self, node: Node, values: dict[str, Any]) -> None:
        """Takes an even scale out of the to_world of a light that has directions alone."""
        matrix = values["to_world"]
        if matrix is None:
            return
        lengths = np.sqrt((matrix[:3, :3] * matrix[:3, :3]).sum(axis=0)).tolist()
        scale = lengths[0]
        if abs(scale - 1) > 5e-4 and max(lengths) - min(lengths) <= 1e-3 * scale:
            values["to_world"] = transform.compose(matrix, transform.scale([1 / scale] * 3))
            text = f"{node}: to_world scales by {scale:g}, which a light of directions leaves out; "
            self.report.warn(f"{text}Mitsuba's is distorted", node.values["to_world"].where)

    def up_to(self, most: float, child: Node) -> Node:
        """A texture's node where its numbers may be up to another than 1."""
        return self.copy(self.larger.setdefault(most, {}), child, exchange=False)

    def light_texture(self, node: Node, name: str) -> tuple[int, tuple[int, int], list[Attribute]]:
        """Index of the texture that a parameter of a light is, -1 for none, its size, and what it
        reads from meshes."""
        items = [item for item in node.children if item.name == name]
        if not items:
            return -1, (1, 1), []
        if name in node.values or len(items) > 1:
            raise SceneError(f'{node}: "{name}" is given twice', items[-1].where)
        child = self.up_to(math.inf, self.child(items[0], node))
        row, attributes = self.texture(child, math.inf)
        if attributes and node.plugin != "area":
            text = f"{node}: a mesh_attribute is of meshes, allowed on lights of plugin area alone"
            raise SceneError(text, child.where)
        size = row.get("texture_width", 1), row.get("texture_height", 1)
        return self.tables.index("textures", child, row), size, attributes

    def spot_image(self, node: Node, values: dict[str, Any], matrix: Array) -> dict[str, Any]:
        """The columns of a spot's texture, which covers the square about its cone."""
        if values["texture"] is not None:
            raise SceneError(
                f'{node}: "texture" is a colour, expected a texture; a colour belongs to intensity',
                node.values["texture"].where,
            )
        image, _, _ = self.light_texture(node, "texture")
        if image < 0:
            return {}
        cutoff = values["cutoff_angle"]
        if cutoff >= 90:
            raise SceneError(
                f"{node}: cutoff_angle = {cutoff:g} with a texture; expected less than 90",
                node.where,
            )
        half = tan_half_degrees(2 * cutoff)
        return {"light_texture": image, "light_image": _on_plane(matrix, 0.5 / half, 0.5 / half)}

    def projector_image(self, node: Node, values: dict[str, Any], matrix: Array) -> dict[str, Any]:
        """The columns of a projector but for its place and direction."""
        image, size, _ = self.light_texture(node, "irradiance")
        fov, axis = field_of_view(node, values)
        view = located(node, lambda: Camera(matrix, fov, axis))
        # Mitsuba's images have two rows and two columns at least.
        halves = [of(*(max(n, 2) for n in size)) for of in (view.tan_half_x, view.tan_half_y)]
        axes = _on_plane(matrix, -0.5 / halves[0], -0.5 / halves[1])
        return {"light_texture": image, "light_image": axes}


def _hull(node: Node, values: dict[str, Any]) -> Array | None:
    """Points (8, 3) in the world whose hull a shape is within; None if its file has to be read."""
    if node.plugin not in ("cube", "sphere"):
        return None
    centre, radius = values.get("center") or (0.0,) * 3, values.get("radius") or 1.0
    corners = np.array([*itertools.product((-1.0, 1.0), repeat=3)]) * radius + centre
    matrix = values["to_world"]
    result: Array = corners @ matrix[:3, :3].T + matrix[:3, 3]
    return result


_SKIES = ("constant", "envmap", "sunsky", "timed_sunsky")
_GREY = Node("diffuse", "", "bsdf")
_LAMP = Node("diffuse", "", "bsdf")
#: Rows of defaults of the tables that are not filled by `Shapes`.
_TABLES = {
    table: blank_row(table)
    for table in TABLES
    if table not in (*Shapes.TABLES, "texels", "cells", "attributes", "phase_values")
}


class _Tables:
    """Rows of the scene's tables, one for each object that is used, in the order of use."""

    def __init__(self) -> None:
        self.rows: dict[str, dict[Any, tuple[int, Any, dict[str, Any]]]] = {
            name: {} for name in _TABLES
        }

    def index(self, table: str, key: Node | tuple[int, int], row: dict[str, Any]) -> int:
        """The index of the row of `key`, which is `row` if it is new."""
        rows = self.rows[table]
        name = key if isinstance(key, tuple) else id(key)  # the entry keeps the node, and its id
        return rows.setdefault(name, (len(rows), key, row))[0]

    def places(self) -> dict[str, list[str]]:
        """Where the objects of each table's rows are; not of boundaries, which two objects make."""
        return {
            table: [key.where for _, key, _ in rows.values()]
            for table, rows in self.rows.items()
            if table != "boundaries"
        }

    def objects(self) -> Objects:
        """Which rows the objects became: those that have an id, and all that materials are of."""
        uses: dict[Any, tuple[str, list[Use]]] = {}

        def add(key: Any, name: str, use: Use) -> None:
            uses.setdefault(key, (name, []))[1].append(use)

        for table in ("media", "lights", "emissions", "textures"):
            for number, key, row in self.rows[table].values():
                if isinstance(key, Node) and key.id:  # copies of textures have the same
                    form, exchanged = row.get("form", ""), row.get("exchanged", False)
                    use = Use(table, number, form=form, exchanged=exchanged)
                    add((table, key.id), key.id, use)
        holders: dict[str, int] = {}
        merged: set[str] = set()
        products: set[tuple[int, str]] = set()
        for number, _, row in self.rows["materials"].values():
            names = row.get("names", {})
            for part, (nodes, form) in materials.objects(row).items():
                key = part, *map(id, nodes)  # rows hold the nodes, and so their ids
                name = "" if len(nodes) > 1 else nodes[0].id or names.get(part, "")
                add(key, name, Use("materials", number, part, form))
            for name in row.get("holders", ()):
                holders.setdefault(name, number)
            merged.update(row.get("merged", ()))
            products.update((number, part) for part in row.get("products", ()))
        found = (Object(name, tuple(places)) for name, places in uses.values())
        return Objects(found, holders, merged, products)

    def arrays(self) -> dict[str, Any]:
        """The arguments of Scene; None for the columns of an empty table."""
        found: dict[str, Any] = {}
        for table, blanks in _TABLES.items():
            rows = [row for _, _, row in self.rows[table].values()]
            given: set[str] = set().union(*rows)
            for column, blank in blanks.items():
                if column in given:
                    found[column] = [row.get(column, blank) for row in rows]
                else:
                    found[column] = [blank] * len(rows) or None
        return found


def _masked(row: materials.Row) -> bool:
    return bool(row["opacity"] < 1 or row.get("opacity_texture", -1) >= 0)


def _lets_through(row: materials.Row) -> bool:
    return _masked(row) or MATERIAL_KINDS[row["material_kind"]] not in OPAQUE_KINDS


def _on_plane(matrix: Array, x: float, y: float) -> list[list[float]]:
    """The first two axes of a rigid matrix, of lengths x and y."""
    axes = (transform.unit(matrix[:3, k].tolist(), "") for k in (0, 1))
    return [[x * a for a in next(axes)], [y * b for b in next(axes)]]


def _shines(radiance: tuple[float, ...]) -> bool:
    return any(np.float32(x) for x in radiance)
