"""Mitsuba 3 scene files (XML), a subset: see `plugins` for the objects and their parameters.

Elements: an object by its category (shape, bsdf, ...) with type and optional id; float, integer,
boolean, string, rgb, srgb, spectrum (see `spectra`), point, vector, transform (translate, scale,
rotate, lookat, matrix, each applied after those before it); ref; alias; default; include; path, a
folder in which files are looked for first. "$name" in an attribute is replaced by the parameter of
that name, unless a backslash precedes it; one without a value leaves the default, with a note,
where it changes no light: in a film, a sampler or a filter, and as the type of these and of an
integrator. A type in other letters, as "Rectangle", is read with a note. Versions below 2: see
`upgrade`. As in Mitsuba, comments may hold anything but their end, "&" in an attribute may stand
for itself, and text between elements counts for nothing. A file is UTF-8, UTF-16 or UTF-32, or
ISO-8859-1 where it says so or is none of these. Limits: no DOCTYPE, no entities, 16 MiB a file,
includes 8 deep and 256 in all.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Mapping
from functools import lru_cache
from itertools import islice
from pathlib import Path
from xml.parsers import expat

import numpy as np
import numpy.typing as npt
from lxml import etree

from .. import transform as tf
from ..errors import SceneError
from ..files import open_regular
from . import spectra, upgrade
from .known import MITSUBA, missing
from .node import (
    MAX_DEPTH,
    Node,
    Ref,
    Tree,
    Value,
    allowed,
    parse_float,
    parse_floats,
    parse_integer,
    quoted,
    read_bytes,
    shorten,
)
from .plugins import CATEGORIES, PLUGINS
from .report import Report

Array = npt.NDArray[np.float64]
MAX_BYTES = 16 * 2**20
MAX_INCLUDE_DEPTH = 8
MAX_INCLUDES = 256
_PARAMETER = re.compile(r"\\\$|\$(?:\{([^\s${}]+)\}|([^\s$]*))")
_PLAIN = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
_VERSION = re.compile(r"\s*0*([0-9])(?:\.([0-9]{1,9}))?(?:\.[0-9]{1,9})?(?:[^0-9.].{0,32})?")
_MARKS = (
    (b"\xef\xbb\xbf", "utf-8"),
    (b"\xff\xfe\0\0", "utf-32-le"),
    (b"\0\0\xfe\xff", "utf-32-be"),
    (b"\xff\xfe", "utf-16-le"),
    (b"\xfe\xff", "utf-16-be"),
    (b"<\0\0\0", "utf-32-le"),
    (b"\0\0\0<", "utf-32-be"),
    (b"<\0", "utf-16-le"),
    (b"\0<", "utf-16-be"),
)
_LATIN = re.compile(
    rb"\s*<\?xml[^>]{0,200}\sencoding\s*=\s*[\"'](?:iso-8859-1|latin-?1)[\"']", re.IGNORECASE
)
#: What is skipped on the way to a comment, and its end.
_APART = {"<!--": "-->", "<?": "?>", "<![CDATA[": "]]>"}
_BEGIN = re.compile("|".join(map(re.escape, _APART)))
_TAG = re.compile(r"<[A-Za-z_][^<>]*&[^<>]*>")
_AMPERSAND = re.compile(r"&(?!(?:amp|lt|gt|quot|apos|#[0-9]{1,7}|#x[0-9A-Fa-f]{1,6});)")
_DECLARATION = re.compile(r"\A\s*<\?xml\s[^<>]{0,1000}\?>")
#: Objects that change no light: what has no value in them, and what they are, takes the default.
_DEFAULTS = {"film": "hdrfilm", "sampler": "independent", "rfilter": "gaussian"}
_VALUE_TAGS = ("float", "integer", "boolean", "string", "rgb", "srgb", "spectrum")
_OTHER_TAGS = ("point", "vector", "transform", "ref", "alias", "default", "include", "path")


def read(path: Path, parameters: Mapping[str, object], report: Report | None = None) -> Tree:
    """Reads a file; `parameters` overrides its <default> values. Raises SceneError for a file that
    is none of the format; `report` takes all other faults, and the tree is then not complete."""
    reader = _Reader(parameters, Report() if report is None else report)
    reader.folders[path] = [path.parent]
    root, name = reader.parse(path, "")
    where = f"{name}:{root.sourceline}"
    if root.tag != "scene":
        raise SceneError(f"the root element is <{root.tag}>, expected <scene>", where)
    reader.version(root, where)
    reader.tree.scene.where = where
    reader.tree.scene.folder = str(path.parent)
    reader.children(root, reader.tree.scene, path, (path.resolve(),), 1)
    for key in reader.given:
        if key not in reader.used:
            reader.report.add(
                SceneError(
                    f'parameter "{key}" = {shorten(reader.values[key])} is not used by the scene'
                    + allowed(key, reader.used | set(reader.values) - reader.given, "it has"),
                    name,
                )
            )
    for text, place in reader.upgraded.listed():
        reader.report.note(text, place)
    for text, place in reader.upgraded.approximated:
        reader.report.warn(text, place)
    return reader.tree


class _NoValue(Exception):  # noqa: N818
    """A parameter of the file that nobody gave, and where; the text does without the place."""

    def __init__(self, text: str, where: str) -> None:
        super().__init__(text)
        self.where = where


class _Reader:
    def __init__(self, parameters: Mapping[str, object], report: Report) -> None:
        self.values = {str(key): _text(value) for key, value in parameters.items()}
        self.given = set(self.values)
        self.used: set[str] = set()
        self.odd = not all(map(_PLAIN.fullmatch, self.values))  # a name that is no identifier
        self.includes = 0
        self.expanded = 0
        self.report = report
        self.tree = Tree(Node("scene", "", "scene"), report=report)
        self.spectra: dict[str, Value] = {}  # by id
        self.upgraded = upgrade.Notes()
        self.old = False  # whether the file being read is of a version below 2
        self.early = False  # and below 0.4
        self.folders: dict[Path, list[Path]] = {}  # of each file, in the order of the search
        self.included: dict[Path, tuple[Path, ...]] = {}  # folders of it and of those between

    def find(self, name: str, path: Path, where: str, *, asset: bool = False) -> tuple[Path, str]:
        """Where the file is that `name` in the file `path` means, and its name there: the first
        search folder that has it, else, as in Mitsuba, the working directory; if none does, the
        folder of `path`. asset: the folder of an included file comes after those of the file that
        includes it, as Mitsuba looks for assets in the latter alone. Backslashes may stand for
        slashes. Of a path of another machine, the longest end that is found counts, and then the
        only file of its name in a folder of theirs."""
        folders = self.folders[path]
        if asset:
            folders = sorted(folders, key=lambda folder: folder in self.included.get(path, ()))
        for text in dict.fromkeys((name, name.replace("\\", "/"))):
            for folder in (*folders, Path()):
                try:
                    if not (folder / text).exists():
                        continue
                except (OSError, ValueError):  # no possible name
                    return path.parent, name
                if text != name:
                    self.report.note(f"{shorten(name)} is read as {shorten(text)}", where)
                if folder not in self.folders[path]:
                    self.report.note(f"{shorten(text)} is found in the working directory", where)
                return folder, text
        if re.match(r"[\\/]|[A-Za-z]:[\\/]", name):
            ends = [part for part in re.split(r"[\\/]+", name) if part][:64]
            texts = ["/".join(ends[first:]) for first in range(1, len(ends))]
            found = [
                (folder, text)
                for text in texts
                for folder in self.folders[path]
                if ".." not in ends and os.path.isfile(folder / text)
            ]
            if not found and ends and ".." not in ends:
                below = {
                    os.path.realpath(folder / inside): (folder, f"{inside}/{ends[-1]}")
                    for folder in self.folders[path]
                    for inside in _folders(folder)
                    if os.path.isfile(folder / inside / ends[-1])
                }
                found = list(below.values()) if len(below) == 1 else []
            if found:
                folder, text = found[0]
                self.report.warn(f"{shorten(name)} is not there; {text} is read", where)
                return folder, text
        return path.parent, name

    def parse(self, path: Path, where: str) -> tuple[etree._Element, str]:
        name = str(path)
        text, encoding = _decoded(read_bytes(path, MAX_BYTES, where), name)
        if encoding:
            self.report.note(f"not UTF-8 text: it is read as {encoding}", name)
        text = _with_ampersands(_without_comments(text))
        text = _DECLARATION.sub(lambda m: "\n" * m[0].count("\n"), text)  # as Mitsuba: unread
        _refuse_doctype(text, name)
        parser = etree.XMLParser(
            encoding="utf-8",
            resolve_entities=False,
            no_network=True,
            load_dtd=False,
            huge_tree=False,
            remove_comments=True,
            remove_pis=True,
        )
        try:
            root = etree.fromstring(text.encode(), parser)
        except etree.XMLSyntaxError as error:
            line = error.lineno or 1
            reason = " ".join(str(error.msg).split())
            raise SceneError(f"not well-formed XML: {reason}", f"{name}:{line}") from None
        return root, name

    def version(self, root: etree._Element, where: str) -> None:
        version = root.get("version")
        if version is None:
            raise SceneError('<scene> has no version; write version="3.0.0"', where)
        match = _VERSION.fullmatch(version)
        if not match:
            raise SceneError(f"version = {shorten(version)}, expected 0.x.x to 9.x.x", where)
        if match[1] > "3":
            self.report.note(f"version {shorten(version)} is read as 3.x.x", where)
        self.old = match[1] in "01"
        minor = int(match[2] or 0) if match[1] == "0" else 9
        if minor < 3:
            raise SceneError(f"version = {shorten(version)}, expected 0.3.0 or later", where)
        self.early = minor < 4
        if self.old:
            upgrade.upgrade(root, where.rpartition(":")[0], self.upgraded, self.early)

    def attributes(
        self, element: etree._Element, where: str, needed: str, optional: str = ""
    ) -> dict[str, str]:
        """The element's attributes with $names replaced; `needed` and `optional` are names."""
        result = {}
        required, names = _names(needed, optional)
        for key, text in element.items():
            if key not in names:
                raise SceneError(
                    f"<{element.tag}> has an unknown attribute {shorten(key)} = {shorten(text)}"
                    + allowed(str(key), names),
                    where,
                )
            if "$" in text:
                text = _PARAMETER.sub(lambda m: self.lookup(m, where), str(text))
            result[str(key)] = str(text)
        for key in required:
            if key not in result:
                raise SceneError(f'<{element.tag}> lacks the attribute "{key}"', where)
        return result

    def lookup(self, match: re.Match[str], where: str) -> str:
        if match[0] == "\\$":
            return "$"
        key, rest = match[1] or "", ""
        if match[2]:
            word = _PLAIN.match(match[2])
            key = word[0] if word else ""
            if key not in self.values or self.odd:  # as Mitsuba: the longest name that begins it
                known = [name for name in self.values if name and match[2].startswith(name)]
                key = max(known, key=len, default=key)
            rest = match[2][len(key) :]
        if not key:
            raise SceneError('"$" must be followed by the name of a parameter', where)
        if key not in self.values:
            raise _NoValue(
                f'parameter "${key}" has no value; give it by -D {key}=... or <default>'
                + allowed(key, self.values, "known"),
                where,
            )
        self.used.add(key)
        self.expanded += len(self.values[key])
        if self.expanded > MAX_BYTES:
            raise SceneError(f"parameters expand to more than {MAX_BYTES} characters", where)
        return self.values[key] + rest

    def children(
        self,
        element: etree._Element,
        node: Node,
        path: Path,
        chain: tuple[Path, ...],
        depth: int,
    ) -> None:
        """Adds the element's children to `node`."""
        if depth > MAX_DEPTH:
            raise SceneError(f"nested deeper than {MAX_DEPTH}", f"{path}:{element.sourceline}")
        self.stray(element, element.text, path)
        for child in element:
            where = f"{path}:{child.sourceline}"
            self.stray(element, child.tail, path)
            try:
                if not isinstance(child.tag, str):
                    raise SceneError("entities are not allowed", where)
                self.child(child, node, path, chain, depth, where)
            except SceneError as error:
                self.report.add(error)
                node.faulty = True
            except _NoValue as error:
                self.report.add(SceneError(str(error), error.where))
                node.faulty = True

    def child(
        self,
        child: etree._Element,
        node: Node,
        path: Path,
        chain: tuple[Path, ...],
        depth: int,
        where: str,
    ) -> None:
        """Adds a child to `node`."""
        tag = str(child.tag)
        if tag == "include":
            self.include(child, node, path, chain, depth, where)
        elif tag == "default":
            a = self.attributes(child, where, "name value")
            if not re.fullmatch(r"[^\s${}\\]+", a["name"]):
                raise SceneError(f"<default> has a bad name {shorten(a['name'])}", where)
            self.odd |= not _PLAIN.fullmatch(a["name"])
            self.values.setdefault(a["name"], a["value"])
            _empty(child, where)
        elif tag == "ref":
            a = self.attributes(child, where, "id", "name")
            if a["id"] in self.spectra and "name" in a:
                self.add(node, a["name"], self.spectra[a["id"]], where)
            else:
                node.children.append(Ref(a["id"], where, a.get("name", "")))
            _empty(child, where)
        elif tag == "alias":
            a = self.attributes(child, where, "id as")
            if a["id"] not in self.tree.ids:
                known = allowed(a["id"], self.tree.ids, "known")
                raise SceneError(f"there is no id {shorten(a['id'])} before this{known}", where)
            self.tree.add_id(self.tree.ids[a["id"]], a["as"], where)
            _empty(child, where)
        elif tag == "path":
            self.search(child, path, depth, where)
        elif tag in _VALUE_TAGS or tag in _OTHER_TAGS or _is_spectrum(child):
            try:
                name, value = self.value(child, path, where)
            except _NoValue as error:
                if node.category not in _DEFAULTS:
                    raise
                told = f'{error}; "{child.get("name")}" of {node} takes its default'
                self.report.note(told, where)
                return
            if name or node.category != "scene":  # a spectrum with an id alone is used by ref
                self.add(node, name, value, where)
        elif (tag in CATEGORIES and tag != "scene") or tag in MITSUBA:
            node.children.append(self.object(child, path, chain, depth, where))
        elif tag == "animation":
            raise SceneError(
                '<animation>: nothing moves here; write one <transform name="to_world"> in its '
                "place, where it stands still",
                where,
            )
        else:
            names = (*CATEGORIES[1:], *_VALUE_TAGS, *_OTHER_TAGS)
            raise SceneError(f"unknown element <{tag[:64]}>{allowed(tag, names)}", where)

    def stray(self, element: etree._Element, text: str | None, path: Path) -> None:
        """Notes text in an element that holds none, which counts for nothing."""
        if text and not text.isspace():
            told = f"<{element.tag}> holds text, which is not read"
            self.report.note(told, f"{path}:{element.sourceline}")

    def search(self, element: etree._Element, path: Path, depth: int, where: str) -> None:
        """Adds a folder before those in which the files of `path` are looked for."""
        name = self.attributes(element, where, "value")["value"]
        _empty(element, where)
        if depth > 1:
            raise SceneError("<path> must stand directly in <scene>", where)
        folder = Path(*self.find(name, path, where))
        if os.path.isdir(folder):
            self.folders[path].insert(0, folder)
        else:
            self.report.note(f"<path>: {shorten(name)} is no folder; nothing is looked for", where)

    def add(self, node: Node, name: str, value: Value, where: str) -> None:
        first = node.values.get(name)
        if first is not None:
            text = f'{node}: "{name}" is given twice, first at {first.where}'
            if not _same(first, value) and node.category not in _DEFAULTS:
                if not self.old:  # version 0.x warned
                    raise SceneError(text, where)
                self.report.warn(f"{text}; the last counts", where)
            else:
                self.report.note(f"{text}; the last counts", where)
        node.values[name] = value

    def object(
        self, element: etree._Element, path: Path, chain: tuple[Path, ...], depth: int, where: str
    ) -> Node:
        optional = "id name version" if depth == 0 else "id name"
        tag = str(element.tag)
        try:
            a = self.attributes(element, where, "type", optional)
        except _NoValue as error:
            default = _DEFAULTS.get(tag, "path" if tag == "integrator" else "")
            if not default or "$" not in (element.get("type") or ""):
                raise
            element.set("type", default)
            a = self.attributes(element, where, "type", optional)
            self.report.note(f"{error}; the {tag} is {default}", where)
        plugin = a["type"]
        small = plugin.lower()
        if plugin != small and small in PLUGINS and PLUGINS[small].category == tag:
            text = f"{tag} {shorten(plugin)} is read as {shorten(small)}"
            self.report.note(f"{text}, as by Mitsuba where file names have no case", where)
            plugin = small
        node = Node(plugin, where, tag, a.get("id", ""), name=a.get("name", ""))
        supported = plugin in PLUGINS and PLUGINS[plugin].category == tag
        if not supported:  # what it holds is read, for what else is missing
            self.report.add(SceneError(missing(tag, plugin), where))
            node.plugin, node.faulty = "", True
        if node.id:
            self.tree.add_id(node)
        self.children(element, node, path, chain, depth + 1)
        if not supported:
            self.tree.orphans += [child for child in node.children if isinstance(child, Node)]
        elif "filename" in PLUGINS[plugin].params:
            given = node.values.get("filename")
            folder = path.parent
            if given is not None and isinstance(given.value, str):
                folder, given.value = self.find(given.value, path, given.where, asset=True)
            node.folder = str(folder)
            if self.old and plugin == "obj" and given is not None:
                self.library(node, Path(folder) / str(given.value))
        return node

    def library(self, node: Node, path: Path) -> None:
        """Warns of an OBJ file's materials, which a shape without a bsdf had in version 0.x unless
        it said otherwise."""
        given = node.values.get("load_materials")
        if given is not None and given.value is False:
            return
        for child in node.children:
            if not child.name if isinstance(child, Ref) else child.category == "bsdf":
                return
        try:
            with open_regular(path) as file:
                found = re.search(rb"(?m)^[ \t]*mtllib[ \t]+(\S[^\r\n]*)", file.read(1 << 16))
            name = found[1].decode("utf-8", "replace").strip() if found else ""
            if name and (path.parent / name).is_file():
                text = f"obj: version 0.x took the materials of {quoted(name.encode())}"
                self.report.warn(f"{text}; here it is grey", node.where)
        except (OSError, ValueError):  # said where the mesh is read
            return

    def include(
        self,
        element: etree._Element,
        node: Node,
        path: Path,
        chain: tuple[Path, ...],
        depth: int,
        where: str,
    ) -> None:
        a = self.attributes(element, where, "filename", "name")
        name = a["filename"]
        _empty(element, where)
        target = Path(*self.find(name, path, where))
        try:
            resolved = target.resolve()
        except (OSError, RuntimeError, ValueError) as error:
            raise SceneError(f"cannot read {shorten(name)}: {error}", where) from None
        if resolved in chain:
            raise SceneError(f"{shorten(name)} includes itself", where)
        self.includes += 1
        if len(chain) > MAX_INCLUDE_DEPTH or self.includes > MAX_INCLUDES:
            raise SceneError(
                f"more than {MAX_INCLUDE_DEPTH} nested or {MAX_INCLUDES} included files", where
            )
        root, file = self.parse(target, where)
        self.folders[target] = [target.parent, *self.folders[path]]
        self.included[target] = (target.parent, *self.included.get(path, ()))
        old = self.old, self.early
        inside = f"{file}:{root.sourceline}"
        if root.tag == "scene":
            self.version(root, inside)
            self.children(root, node, target, (*chain, resolved), depth)
        elif root.tag in CATEGORIES:
            if "version" in root.attrib:
                self.version(root, inside)
            elif self.old:
                upgrade.upgrade(root, file, self.upgraded, self.early)
            child = self.object(root, target, (*chain, resolved), 0, inside)
            child.name = a.get("name", child.name)
            node.children.append(child)
        else:
            raise SceneError(
                f"the root element of an included file is <{root.tag}>"
                + allowed(str(root.tag), CATEGORIES),
                inside,
            )
        self.old, self.early = old

    def value(self, element: etree._Element, path: Path, where: str) -> tuple[str, Value]:
        kind = str(element.tag)
        if kind == "transform":
            name = self.attributes(element, where, "", "name").get("name", "to_world")
            return name, Value(kind, self.transform(element, path), where)
        if kind == "spectrum" or kind == "texture":
            return self.spectrum(element, path, where)
        _empty(element, where)
        if kind in ("point", "vector"):
            a = self.attributes(element, where, "name", "value x y z")
            vector = self.vector(a, kind, where, 0.0)
            return a["name"], Value(kind, vector, where)
        a = self.attributes(element, where, "name value")
        name, text = a["name"], a["value"]
        label = f'"{name}"'
        if kind == "float" and name == "far_clip" and text.strip().lower() in ("inf", "infinity"):
            return name, Value(kind, np.inf, where)
        if kind == "float":
            return name, Value(kind, parse_float(text, label, where), where)
        if kind == "integer":
            return name, Value(kind, parse_integer(text, label, where), where)
        if kind == "boolean":
            word = text.strip().lower()
            if word not in ("true", "false"):
                raise SceneError(f"{label} = {shorten(text)}, expected true or false", where)
            return name, Value(kind, word == "true", where)
        if kind == "rgb":
            return name, Value(kind, spectra.parse_rgb(text, label, where), where)
        if kind == "srgb":
            return name, Value("rgb", spectra.srgb(text, label, where), where)
        return name, Value(kind, text, where)

    def spectrum(self, element: etree._Element, path: Path, where: str) -> tuple[str, Value]:
        """A spectrum by text, by file or as an object; its name is "" where it has none."""
        if element.get("type") is None:
            a = self.attributes(element, where, "name", "value filename")
            _empty(element, where)
            label = f'"{a["name"]}"'
            if ("value" in a) == ("filename" in a):
                raise SceneError(f"{label}: give either value or filename", where)
            if "value" in a:
                found = spectra.parse(a["value"], label, where)
            else:
                found = spectra.read_spd(Path(*self.find(a["filename"], path, where)), label, where)
            return a["name"], Value("spectrum", found, where)
        a = self.attributes(element, where, "type", "name id")
        if a["type"] not in spectra.PLUGINS:
            known = allowed(a["type"], spectra.PLUGINS)
            raise SceneError(f"unknown spectrum {shorten(a['type'])}{known}", where)
        self.stray(element, element.text, path)
        given: dict[str, Value] = {}
        nested = []
        for child in element:
            here = f"{path}:{child.sourceline}"
            self.stray(element, child.tail, path)
            if child.tag not in (*_VALUE_TAGS, "point", "vector", "texture"):
                raise SceneError(f"a spectrum cannot hold {shorten(str(child.tag))}", here)
            name, value = self.value(child, path, here)
            if child.get("type") is not None:
                nested.append(value)
            elif name in given:
                raise SceneError(f'{a["type"]}: "{name}" is given twice', here)
            else:
                given[name] = value
        found = spectra.plugin(a["type"], given, nested, where)
        if "id" in a:
            if a["id"] in self.spectra:
                raise SceneError(f'id "{a["id"]}" is already used', where)
            self.spectra[a["id"]] = found
        return a.get("name", ""), found

    def vector(
        self, a: dict[str, str], label: str, where: str, default: float
    ) -> tuple[float, ...]:
        """Three numbers from value="..." (one or three) or from x, y and z."""
        if "value" in a:
            if {"x", "y", "z"} & set(a):
                raise SceneError(f'{label}: give either "value" or x, y and z', where)
            numbers = parse_floats(a["value"], f'{label}: "value"', where, (1, 3))
            return numbers * (3 // len(numbers))
        return tuple(
            parse_float(a[axis], f'{label}: "{axis}"', where) if axis in a else default
            for axis in "xyz"
        )

    def transform(self, element: etree._Element, path: Path) -> Array:
        self.stray(element, element.text, path)
        matrix = np.eye(4)
        for child in element:
            where = f"{path}:{child.sourceline}"
            tag = child.tag
            self.stray(element, child.tail, path)
            if not isinstance(tag, str):
                raise SceneError("entities are not allowed", where)
            _empty(child, where)
            if tag == "translate":
                a = self.attributes(child, where, "", "value x y z")
                step = tf.translate(self.vector(a, tag, where, 0.0))
            elif tag == "scale":
                a = self.attributes(child, where, "", "value x y z")
                step = tf.scale(self.vector(a, tag, where, 1.0))
            elif tag == "rotate":
                a = self.attributes(child, where, "angle", "value x y z")
                angle = parse_float(a.pop("angle"), 'rotate: "angle"', where)
                axis = self.vector(a, tag, where, 0.0)
                if self.old and any(axis):  # as version 0.x
                    axis = tuple(x / math.hypot(*axis) for x in axis)
                fault = tf.axis_fault(axis)
                if fault:
                    self.report.warn(
                        f"rotate: {fault}, not 1: it shears (in Mitsuba points, not normals)", where
                    )
                step = tf.rotate_as_given(axis, angle)
            elif tag == "lookat":
                a = {"up": "0 0 0", **self.attributes(child, where, "origin target", "up")}
                origin, target, up = (
                    parse_floats(a[key], f'lookat: "{key}"', where, (3,))
                    for key in ("origin", "target", "up")
                )
                if up == (0.0, 0.0, 0.0):  # as Mitsuba: any
                    up = tf.any_up(origin, target, where)
                step = tf.look_at(origin, target, up, where)
            elif tag == "matrix":
                a = self.attributes(child, where, "value")
                numbers = parse_floats(a["value"], 'matrix: "value"', where, (9, 16))
                size = 3 if len(numbers) == 9 else 4
                step = np.eye(4)
                step[:size, :size] = np.array(numbers).reshape(size, size)
            else:
                names = ("translate", "scale", "rotate", "lookat", "matrix")
                raise SceneError(f"unknown transform <{tag}>{allowed(tag, names)}", where)
            with np.errstate(over="ignore", invalid="ignore"):
                matrix = tf.compose(step, matrix)
        return matrix


def _folders(folder: Path) -> list[str]:
    """Names of the folders in a folder, of which no one is hidden or a link; 256 at most."""
    try:
        with os.scandir(folder) as entries:
            names = [
                entry.name
                for entry in islice(entries, 10_000)
                if not entry.name.startswith(".") and entry.is_dir(follow_symlinks=False)
            ]
    except OSError:
        return []
    return sorted(names)[:256]


def _refuse_doctype(text: str, name: str) -> None:
    """Raises SceneError for a DOCTYPE, the only place of entities, before any is expanded."""
    parser = expat.ParserCreate("utf-8")

    def doctype(*_: object) -> None:
        where = f"{name}:{parser.CurrentLineNumber}"
        raise SceneError("DOCTYPE and entities are not allowed", where)

    def root(*_: object) -> None:
        raise StopIteration  # no DOCTYPE can follow

    parser.StartDoctypeDeclHandler, parser.StartElementHandler = doctype, root
    try:
        parser.Parse(text, True)
    except StopIteration:
        return
    except expat.ExpatError as error:
        reason = expat.ErrorString(error.code)
        raise SceneError(f"not well-formed XML: {reason}", f"{name}:{error.lineno}") from None


def _same(first: Value, second: Value) -> bool:
    """Whether two values are alike, whatever their places."""
    return first.kind == second.kind and np.array_equal(first.value, second.value)


def _text(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return repr(float(value)) if isinstance(value, float) else str(value)


def _is_spectrum(element: etree._Element) -> bool:
    """Whether it is a spectrum by the element's name <texture>, which Mitsuba takes for both."""
    return bool(element.tag == "texture" and element.get("type") in spectra.PLUGINS)


@lru_cache(maxsize=64)
def _names(needed: str, optional: str) -> tuple[list[str], list[str]]:
    return needed.split(), [*needed.split(), *optional.split()]


def _decoded(data: bytes, name: str) -> tuple[str, str]:
    """The text of a file, and its encoding where that is not a Unicode one and the file does not
    say so. As pugixml: by a byte order mark, by how "<" stands at the beginning, or ISO-8859-1 by
    declaration. Bytes that are no UTF-8 are ISO-8859-1 unless they are no text at all."""
    for mark, encoding in _MARKS:
        if data.startswith(mark):
            mark = b"" if b"<" in mark else mark
            try:
                return data[len(mark) :].decode(encoding), ""
            except UnicodeDecodeError as error:
                text = f"not {encoding.upper()} text (byte {error.start + len(mark)})"
                raise SceneError(text, name) from None
    if _LATIN.match(data):
        return data.decode("latin-1"), ""
    try:
        return data.decode("utf-8"), ""
    except UnicodeDecodeError as error:
        if b"\0" in data:
            raise SceneError(f"not UTF-8 text (byte {error.start})", name) from None
        return data.decode("latin-1"), "ISO-8859-1"


def _without_comments(text: str) -> str:
    """The text with line breaks for comments: of these XML's parsers allow fewer than Mitsuba's."""
    parts, at = [], 0
    while begin := _BEGIN.search(text, at):
        end = text.find(_APART[begin[0]], begin.end())
        if end < 0:
            break
        end += len(_APART[begin[0]])
        comment = begin[0] == "<!--"
        parts.append(text[at : begin.start() if comment else end])
        if comment:
            parts.append("\n" * text.count("\n", begin.start(), end))
        at = end
    return "".join([*parts, text[at:]])


def _with_ampersands(text: str) -> str:
    """The text with &amp; for each "&" in a tag that begins no entity of XML's own."""
    if "&" not in text:
        return text
    return _TAG.sub(lambda tag: _AMPERSAND.sub("&amp;", tag[0]), text)


def _empty(element: etree._Element, where: str) -> None:
    if len(element) or (element.text and element.text.strip()):
        raise SceneError(f"<{element.tag}> must be empty", where)
