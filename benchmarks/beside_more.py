# ruff: noqa: D103, E501 (elements by their names; tables of them)
"""More scenes for `beside_mitsuba.py`: reliefs and blends of each closure, and what files combine."""

from __future__ import annotations

from collections.abc import Iterator

from beside_scenes import (
    BACK,
    BALL,
    BITMAP,
    HILLS,
    PLATE,
    ROOM,
    Case,
    at,
    colour,
    move,
    rotate,
    scale,
    shape,
    staged,
    subjects,
)

METAL = '<rgb name="eta" value="0.2, 0.9, 1.1"/><rgb name="k" value="3.9, 2.4, 2.2"/>'
CLOSURES = {
    "diffuse": '<bsdf type="diffuse"/>',
    "conductor": f'<bsdf type="conductor">{METAL}</bsdf>',
    "roughconductor": f'<bsdf type="roughconductor"><float name="alpha" value="0.25"/>{METAL}</bsdf>',
    "brushed": f'<bsdf type="roughconductor"><float name="alpha_u" value="0.45"/><float name="alpha_v" value="0.12"/>{METAL}</bsdf>',
    "brushed_ggx": f'<bsdf type="roughconductor"><string name="distribution" value="ggx"/><float name="alpha_u" value="0.45"/><float name="alpha_v" value="0.12"/>{METAL}</bsdf>',
    "plastic": '<bsdf type="plastic"/>',
    "roughplastic": '<bsdf type="roughplastic"><float name="alpha" value="0.2"/></bsdf>',
    "dielectric": '<bsdf type="dielectric"/>',
    "roughdielectric": '<bsdf type="roughdielectric"><float name="alpha" value="0.2"/></bsdf>',
    "thindielectric": '<bsdf type="thindielectric"/>',
    "principled": '<bsdf type="principled"><float name="metallic" value="0.4"/><float name="roughness" value="0.3"/><float name="clearcoat" value="0.8"/></bsdf>',
    "principled_glass": '<bsdf type="principled"><float name="spec_trans" value="0.9"/><float name="roughness" value="0.3"/></bsdf>',
    "principledthin": '<bsdf type="principledthin"><float name="diff_trans" value="0.8"/><float name="roughness" value="0.4"/></bsdf>',
    "mask": '<bsdf type="mask"><float name="opacity" value="0.6"/><bsdf type="diffuse"/></bsdf>',
    "null": '<bsdf type="null"/>',
}


def image(name: str, file: str, *more: str) -> str:
    return (f'<texture type="bitmap" name="{name}"><string name="filename" value="{file}"/>'
            f'<boolean name="raw" value="true"/>{"".join(more)}</texture>')  # fmt: skip


def flag(name: str, on: bool) -> str:
    return f'<boolean name="{name}" value="{str(on).lower()}"/>'


def twosided(inside: str) -> str:
    return f'<bsdf type="twosided">{inside}</bsdf>'


def sides(front: str, back: str) -> str:
    named = [x.replace("<bsdf ", f'<bsdf name="{n}" ', 1) for n, x in (("a", front), ("b", back))]
    return f'<bsdf type="twosided">{"".join(named)}</bsdf>'


def normalmap(inside: str, file: str = "normals.png", *more: str) -> str:
    return f'<bsdf type="normalmap">{image("normalmap", file)}{inside}{"".join(more)}</bsdf>'


def bumpmap(inside: str, amount: float = 0.15, *more: str, texture: str = "") -> str:
    return (f'<bsdf type="bumpmap">{texture or image("heights", "heights.png")}'
            f'<float name="scale" value="{amount}"/>{inside}{"".join(more)}</bsdf>')  # fmt: skip


def blend(a: str, b: str, weight: str = '<float name="weight" value="0.4"/>') -> str:
    named = [x.replace("<bsdf ", f'<bsdf name="{n}" ', 1) for n, x in (("a", a), ("b", b))]
    return f'<bsdf type="blendbsdf">{weight}{named[0]}{named[1]}</bsdf>'


SHAPES = {
    "ball": shape("sphere", BALL, "{}"),
    "plate": shape("rectangle", PLATE, "{}"),
    "back": shape("rectangle", BACK, "{}"),
    "hills": shape("ply", HILLS, "{}", "a.ply"),
    "flat_hills": shape("ply", HILLS, flag("face_normals", True) + "{}", "a.ply"),
    "disk": shape("disk", PLATE, "{}"),
    "cylinder": shape("cylinder", at(scale(0.6), rotate("y", 60), move(0, 0, 4.5)), "{}"),
    "cube": shape("cube", at(scale(0.5), rotate("y", 30), rotate("x", 20), move(0, -0.2, 5)), "{}"),
}


def _reliefs() -> Iterator[tuple[str, str]]:
    for name, inside in CLOSURES.items():
        both = (
            inside
            if name
            not in (
                "diffuse",
                "conductor",
                "roughconductor",
                "brushed",
                "brushed_ggx",
                "plastic",
                "roughplastic",
            )
            else twosided(inside)
        )
        yield f"normalmap of {name}", normalmap(both)
        yield (
            f"normalmap of {name}, plain",
            normalmap(
                both,
                "normals.png",
                flag("flip_invalid_normals", False),
                flag("use_shadowing_function", False),
            ),
        )
        yield f"bumpmap of {name}", bumpmap(both)
        yield (
            f"bumpmap of {name}, plain",
            bumpmap(
                both,
                0.15,
                flag("flip_invalid_normals", False),
                flag("use_shadowing_function", False),
            ),
        )
        if both != inside:
            yield f"twosided normalmap of {name}", twosided(normalmap(inside))
            yield f"twosided bumpmap of {name}", twosided(bumpmap(inside))
    matt_ = twosided(CLOSURES["diffuse"])
    for flips in (True, False):
        for shades in (True, False):
            flags = flag("flip_invalid_normals", flips), flag("use_shadowing_function", shades)
            yield (
                f"steep normalmap flips {flips} shades {shades}",
                normalmap(matt_, "steep.png", *flags),
            )
            yield (
                f"steep normalmap of roughplastic flips {flips} shades {shades}",
                normalmap(twosided(CLOSURES["roughplastic"]), "steep.png", *flags),
            )
            yield f"steep bumpmap flips {flips} shades {shades}", bumpmap(matt_, 1.0, *flags)
            yield (
                f"one-sided normalmap flips {flips} shades {shades}",
                normalmap(CLOSURES["diffuse"], "steep.png", *flags),
            )
    yield "bumpmap negative", bumpmap(matt_, -0.2)
    yield (
        "bumpmap to_uv",
        bumpmap(
            matt_,
            0.1,
            texture=image(
                "h", "heights.png", '<transform name="to_uv"><scale x="2" y="1" z="1"/></transform>'
            ),
        ),
    )
    yield (
        "bumpmap nearest",
        bumpmap(
            matt_,
            0.1,
            texture=image("h", "heights.png", '<string name="filter_type" value="nearest"/>'),
        ),
    )
    yield (
        "bumpmap mirror",
        bumpmap(
            matt_,
            0.1,
            texture=image(
                "h",
                "heights.png",
                '<string name="wrap_mode" value="mirror"/>',
                '<transform name="to_uv"><scale value="1.7"/></transform>',
            ),
        ),
    )
    yield (
        "bumpmap clamp",
        bumpmap(
            matt_,
            0.1,
            texture=image(
                "h",
                "heights.png",
                '<string name="wrap_mode" value="clamp"/>',
                '<transform name="to_uv"><scale value="1.7"/></transform>',
            ),
        ),
    )
    yield "bumpmap colours", bumpmap(matt_, 0.1, texture=image("h", "a.png"))
    yield "bumpmap not raw", bumpmap(matt_, 0.1, texture=BITMAP.format("h"))
    yield (
        "normalmap to_uv turned",
        f'<bsdf type="normalmap">{image("normalmap", "normals.png", "<transform name=" + chr(34) + "to_uv" + chr(34) + "><scale x=" + chr(34) + "2" + chr(34) + "/><rotate z=" + chr(34) + "1" + chr(34) + " angle=" + chr(34) + "30" + chr(34) + "/></transform>")}{matt_}</bsdf>',
    )
    yield (
        "normalmap of textured",
        normalmap(twosided(f'<bsdf type="diffuse">{BITMAP.format("reflectance")}</bsdf>')),
    )
    yield (
        "normalmap of rough texture",
        normalmap(
            twosided(f'<bsdf type="roughconductor">{image("alpha", "heights.png")}{METAL}</bsdf>')
        ),
    )
    yield (
        "normalmap of mask of plastic",
        normalmap(
            f'<bsdf type="mask">{image("opacity", "bits.png")}{twosided(CLOSURES["plastic"])}</bsdf>'
        ),
    )
    yield (
        "mask of normalmap of plastic",
        f'<bsdf type="mask">{image("opacity", "bits.png")}{twosided(normalmap(CLOSURES["plastic"]))}</bsdf>',
    )
    yield (
        "mask of bumpmap of roughplastic",
        f'<bsdf type="mask">{image("opacity", "bits.png")}{twosided(bumpmap(CLOSURES["roughplastic"]))}</bsdf>',
    )


def _blends() -> Iterator[tuple[str, str]]:
    weight = image("weight", "bits.png")
    for name in CLOSURES:
        both = CLOSURES[name]
        yield f"blend of diffuse and {name}", blend(CLOSURES["diffuse"], both)
        yield (
            f"blend of {name} and roughplastic by image",
            blend(both, CLOSURES["roughplastic"], weight),
        )
        yield (
            f"twosided blend of plastic and {name}",
            twosided(blend(CLOSURES["plastic"], both))
            if name
            not in (
                "dielectric",
                "roughdielectric",
                "thindielectric",
                "principled_glass",
                "principledthin",
                "mask",
                "null",
            )
            else blend(twosided(CLOSURES["plastic"]), both),
        )
    for value in ("0", "1", "0.999"):
        yield (
            f"blend weight {value}",
            blend(
                CLOSURES["diffuse"],
                CLOSURES["roughconductor"],
                f'<float name="weight" value="{value}"/>',
            ),
        )
    three = ("roughconductor", "roughplastic", "principled")
    first, second, third = (CLOSURES[name] for name in three)
    thirds = '<float name="weight" value="0.3"/>'
    yield "blend of three", blend(first, blend(second, third, thirds))
    yield "blend of three, by images", blend(first, blend(second, third, weight), weight)
    yield "blend of three, the first a blend", blend(blend(first, second, weight), third)
    yield (
        "blend of four",
        blend(blend(first, second, thirds), blend(third, CLOSURES["diffuse"], thirds)),
    )
    yield "blend of two sides", blend(CLOSURES["diffuse"], sides(first, second))
    for name in ("conductor", "roughconductor", "plastic", "roughplastic", "principled"):
        yield f"two sides, diffuse and {name}", sides(CLOSURES["diffuse"], CLOSURES[name])
        yield f"two sides, {name} and diffuse", sides(CLOSURES[name], CLOSURES["diffuse"])
    yield "two sides of maps", sides(normalmap(second), bumpmap(first))
    yield "two sides, the back a blend", sides(CLOSURES["diffuse"], blend(first, second))
    yield (
        "mask of two sides in a mask",
        f"""<bsdf type="mask"><float name="opacity" value="0.7"/><bsdf type="mask">
        <float name="opacity" value="0.6"/>{sides(first, CLOSURES["diffuse"])}</bsdf></bsdf>""",
    )
    yield (
        "normalmap of blend",
        normalmap(blend(twosided(CLOSURES["diffuse"]), twosided(CLOSURES["roughconductor"]))),
    )
    yield (
        "bumpmap of blend",
        bumpmap(blend(twosided(CLOSURES["diffuse"]), twosided(CLOSURES["roughplastic"]))),
    )
    yield (
        "blend of normalmaps",
        blend(normalmap(CLOSURES["diffuse"]), bumpmap(CLOSURES["roughconductor"])),
    )
    yield (
        "mask of blend",
        f'<bsdf type="mask"><float name="opacity" value="0.5"/>{blend(CLOSURES["diffuse"], CLOSURES["roughplastic"])}</bsdf>',
    )
    yield (
        "blend weight by colour image",
        blend(CLOSURES["diffuse"], CLOSURES["roughplastic"], BITMAP.format("weight")),
    )
    yield (
        "blend weight by checkerboard",
        blend(
            CLOSURES["diffuse"],
            CLOSURES["roughplastic"],
            '<texture type="checkerboard" name="weight"><float name="color0" value="0.1"/><float name="color1" value="0.9"/></texture>',
        ),
    )


def more() -> Iterator[Case]:
    for name, made in (*_reliefs(), *_blends()):
        yield Case(name, staged(ROOM + subjects(made)))
    for name, one in SHAPES.items():
        yield Case(
            f"normalmap on {name}",
            staged(ROOM + one.replace("{}", normalmap(twosided(CLOSURES["roughplastic"])))),
        )
        yield Case(
            f"bumpmap on {name}",
            staged(ROOM + one.replace("{}", bumpmap(twosided(CLOSURES["roughplastic"])))),
        )
        yield Case(
            f"texture on {name}",
            staged(
                ROOM
                + one.replace(
                    "{}", twosided(f'<bsdf type="diffuse">{BITMAP.format("reflectance")}</bsdf>')
                )
            ),
        )
        yield Case(
            f"brushed on {name}",
            staged(ROOM + one.replace("{}", twosided(CLOSURES["brushed_ggx"]))),
        )
        yield Case(f"glass on {name}", staged(ROOM + one.replace("{}", CLOSURES["dielectric"])))
        yield Case(
            f"lamp on {name}",
            staged(
                ROOM
                + one.replace("{}", f'<emitter type="area">{BITMAP.format("radiance")}</emitter>')
            ),
        )
        yield Case(
            f"flipped lamp on {name}",
            staged(
                ROOM
                + one.replace(
                    "{}",
                    flag("flip_normals", True)
                    + f'<emitter type="area">{colour("radiance", 2, 1, 3)}</emitter>',
                )
            ),
        )
