"""Draws both fingertips from the STL files for docs/images. ``python
hardware/pictures.py [FOLDER]``."""

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path

import matplotlib as mpl

mpl.use("agg")
import matplotlib.pyplot as plt
import numpy as np
from dimensions import Board, CoilCase, FingerDimensions, placed, towards, underside
from manifold3d import Manifold, Mesh
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.patches import PathPatch
from matplotlib.path import Path as Outline
from numpy.typing import NDArray

Vector = NDArray[np.float64]
Painter = Callable[[Axes], None]
PARTS = Path(__file__).parent / "parts"
FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("spare", "<u2")])
FINGER = FingerDimensions()
BOARD = Board()
CASE = CoilCase()

COLOURS = {
    "pad": "#4c8ed9",
    "piezo disc": "#d9a441",
    "ring": "#7fb2e8",
    "silicone bed": "#d8d4cc",
    "phalanx": "#8a93a1",
    "MEMS board": "#5aa36f",
    "stick adapter": "#b9a6d3",
    "pouring jig": "#d9a7a0",
    "ball guide": "#d9a7a0",
    "weight yoke": "#e0b45a",
    "case": "#4c8ed9",
    "voice coil": "#d9a441",
    "lid": "#8a93a1",
}


BELOW = ("pad", "case", "pouring jig")
"""Parts whose names stand below them."""

BESIDE = ("silicone bed", "ring", "piezo disc")
"""Parts with others before and behind them, whose names stand to the left."""


def read(name: str) -> Manifold:
    """Read a part as it is printed."""
    faces = np.frombuffer((PARTS / f"{name}.stl").read_bytes()[84:], FACET)[
        "corners"
    ].astype(np.float64)
    points, corners = np.unique(
        faces.reshape(-1, 3).round(5), axis=0, return_inverse=True
    )
    triangles = corners.reshape(-1, 3).astype(np.uint32)
    apart = np.array([len(set(triangle)) == 3 for triangle in triangles.tolist()])
    return Manifold(Mesh(points.astype(np.float32), triangles[apart]))


def in_the_finger(name: str) -> Manifold:
    """Read a part and move it to its place in the finger."""
    origin, *axes = placed(name, np.vstack((np.zeros(3), np.eye(3))))
    return read(name).transform(
        np.column_stack([*(axis - origin for axis in axes), origin])
    )


def along_axis(part: Manifold) -> Manifold:
    """Move what was drawn along z to the pad's axis."""
    return part.transform(
        np.column_stack((np.eye(3)[0], FINGER.forward, FINGER.axis, np.zeros(3)))
    )


def robot() -> dict[str, Manifold]:
    """Return the robot's fingertip, put together."""
    disc = along_axis(
        Manifold.cylinder(FINGER.disc_height, FINGER.disc / 2).translate(
            (0, 0, -FINGER.disc_height)
        )
    )
    poured = Manifold.cylinder(FINGER.flange - FINGER.disc_height, FINGER.inner)
    phalanx = in_the_finger("phalanx")
    joint = Manifold.cylinder(FINGER.gap, FINGER.width / 2)
    bed = along_axis((poured + joint).translate((0, 0, -FINGER.flange))) - phalanx
    corners = BOARD.corners(FINGER)
    board = Manifold.hull_points(corners[:8]) + Manifold.hull_points(corners[8:])
    return {
        "pad": in_the_finger("pad"),
        "piezo disc": disc,
        "ring": in_the_finger("ring"),
        "silicone bed": bed,
        "phalanx": phalanx,
        "MEMS board": board,
        "stick adapter": in_the_finger("stick_adapter"),
    }


def exploded(parts: dict[str, Manifold]) -> dict[str, Manifold]:
    """Pull the fingertip apart along the pad's axis, the facet's and the finger's."""
    moves = {
        "pad": 22 * FINGER.axis,
        "piezo disc": 15 * FINGER.axis,
        "ring": 10 * FINGER.axis,
        "silicone bed": 4 * FINGER.axis,
        "MEMS board": 9 * BOARD.out,
        "stick adapter": np.array([0, 0, -22.0]),
    }
    return {
        name: part.translate(tuple(moves.get(name, np.zeros(3))))
        for name, part in parts.items()
    }


def operator(spread: float) -> dict[str, Manifold]:
    """Return the operator's case, pulled apart by ``spread`` mm."""
    coil = Manifold.cube((CASE.width, CASE.height, CASE.length), center=True).translate(
        (0, 0, CASE.length / 2 + 1.6)
    )
    lid = (
        read("coil_case_lid")
        .rotate((180, 0, 0))
        .translate((0, 0, CASE.length + 3.5 + 5.5 * spread))
    )
    return {
        "case": read("coil_case"),
        "voice coil": coil.translate((0, 0, 2.2 * spread)),
        "lid": lid,
    }


def draw(
    axes: Axes,
    parts: dict[str, Manifold],
    away: Vector,
    right: Vector,
    *,
    labels: Sequence[str] = (),
) -> None:
    """Draw solids as seen along ``away``, with ``right`` to the right."""
    up = np.cross(right, away)
    light = -0.6 * away + 0.6 * up - 0.4 * right
    surfaces, spots = [], {}
    for name, part in parts.items():
        mesh = part.refine_to_length(0.7).to_mesh()
        faces = np.asarray(mesh.vert_properties)[:, :3][
            np.asarray(mesh.tri_verts)
        ].astype(np.float64)
        normals = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
        seen = normals @ away < 0
        shade = 0.45 + 0.55 * np.clip(
            normals[seen] @ light / np.linalg.norm(light), 0, 1
        )
        surfaces.append(
            (faces[seen], np.array(mpl.colors.to_rgb(COLOURS[name])) * shade[:, None])
        )
        flat = np.stack(
            [faces.reshape(-1, 3) @ right, faces.reshape(-1, 3) @ up], axis=1
        )
        spots[name] = (flat.min(axis=0), flat.max(axis=0))
    faces = np.concatenate([surface for surface, _ in surfaces])
    colours = np.concatenate([colour for _, colour in surfaces])
    far_first = np.argsort(-(faces @ away).mean(axis=1))
    flat = np.stack([faces @ right, faces @ up], axis=-1)[far_first]
    axes.add_collection(
        PolyCollection(
            flat,
            facecolors=colours[far_first],
            edgecolors=colours[far_first],
            linewidths=0.4,
        )
    )
    axes.update_datalim(flat.reshape(-1, 2))
    for name in labels:
        least, most = spots[name]
        if name in BESIDE:
            middle = (least + most) / 2
            axes.annotate(
                name,
                middle,
                (least[0] - 6, middle[1]),
                ha="right",
                va="center",
                fontsize=11,
                color="#222222",
                arrowprops={"arrowstyle": "-", "color": "#222222", "shrinkB": 0},
            )
            continue
        place = (
            (least[0] + most[0]) / 2,
            least[1] - 3.5 if name in BELOW else most[1] + 1.5,
        )
        axes.text(*place, name, ha="center", fontsize=11, color="#222222")


def section(axes: Axes, parts: dict[str, Manifold]) -> None:
    """Draw the finger cut along its middle, the tip to the left, the side that touches
    below."""
    for name, part in parts.items():
        # z to the left, y up, cut at x = 0.
        turned = part.transform(
            np.array([[0.0, 0, -1, 0], [0, 1, 0, 0], [1.0, 0, 0, 0]])
        )
        points, codes = [], []
        for outline in turned.slice(0.01).to_polygons():
            points += [*outline, outline[0]]
            codes += [
                Outline.MOVETO,
                *[Outline.LINETO] * (len(outline) - 1),
                Outline.CLOSEPOLY,
            ]
        patch = PathPatch(
            Outline(np.array(points), codes),
            facecolor=COLOURS[name],
            edgecolor="#333",
            linewidth=0.6,
        )
        axes.add_patch(patch)
        axes.update_datalim(np.array(points))


def measure(
    axes: Axes,
    begin: Sequence[float],
    end: Sequence[float],
    words: str,
    shift: Sequence[float],
) -> None:
    """Draw a dimension between two points, moved aside by ``shift``, with thin lines
    back to them."""
    moved = [np.add(begin, shift), np.add(end, shift)]
    for place, to in zip((begin, end), moved, strict=True):
        axes.plot(*zip(place, to, strict=True), color="#999", linewidth=0.5)
    axes.annotate(
        "",
        moved[1],
        moved[0],
        arrowprops={"arrowstyle": "<->", "shrinkA": 0, "shrinkB": 0, "linewidth": 0.8},
    )
    middle = np.mean(moved, axis=0)
    box = {"facecolor": "white", "edgecolor": "none", "pad": 0.6}
    axes.text(*middle, words, ha="center", va="center", fontsize=9, bbox=box)


def cut_with_dimensions(axes: Axes) -> None:
    parts = {name: part for name, part in robot().items() if name != "stick adapter"}
    section(axes, parts)
    flat, tilted, port = FINGER.contact(0), FINGER.contact(30), BOARD.port_place(FINGER)
    low, top = (-FINGER.tip, flat[1]), (-FINGER.end, FINGER.nail)
    axes.plot([-16, 36], [flat[1]] * 2, color="#555", linewidth=0.8)
    axes.text(
        37,
        flat[1],
        "surface, finger flat",
        fontsize=9,
        va="center",
        ha="right",
        backgroundcolor="white",
    )
    away = towards(30)
    ends = tilted + np.outer((-11, 13), (0, away[2], -away[1]))
    axes.plot(-ends[:, 2], ends[:, 1], color="#c8553d", linewidth=0.8, linestyle="--")
    axes.text(
        -ends[1, 2] - 1,
        ends[1, 1],
        "tip 30° down",
        fontsize=9,
        color="#c8553d",
        ha="right",
    )
    measure(axes, low, (-flat[2], flat[1]), f"{FINGER.tip - flat[2]:.1f}", (0, -4))
    measure(
        axes,
        (-flat[2], flat[1]),
        (-port[2], port[1]),
        f"{np.linalg.norm(port - flat):.1f}",
        (-9, 0),
    )
    measure(
        axes,
        (top[0], underside(FINGER)),
        top,
        f"{FINGER.nail - underside(FINGER):.1f}",
        (4, 0),
    )
    measure(
        axes,
        (top[0], flat[1]),
        (top[0], underside(FINGER)),
        f"{underside(FINGER) - flat[1]:.1f}",
        (4, 0),
    )
    measure(axes, (-FINGER.tip, top[1]), top, f"{FINGER.tip - FINGER.end:.1f}", (0, 6))
    names = {
        "pad": (tilted * 0.6, (-18, -14)),
        "piezo disc": (-0.2 * FINGER.axis + 4 * FINGER.forward, (-20, -3)),
        "silicone": (-2 * FINGER.axis - 2 * FINGER.forward, (14, -10)),
        "core of the phalanx": (-4.5 * FINGER.axis, (24, -15)),
        "MEMS board": (port, (-16, 22)),
    }
    for words, (place, where) in names.items():
        arrow = {"arrowstyle": "-", "linewidth": 0.6}
        axes.annotate(
            words,
            (-place[2], place[1]),
            where,
            fontsize=9,
            arrowprops=arrow,
            ha="center",
        )


def below_with_dimensions(axes: Axes) -> None:
    draw(axes, robot(), np.array([0, 1.0, 0]), np.array([0, 0, -1.0]))
    half, flat = FINGER.width / 2, FINGER.contact(0)
    axes.plot(-flat[2], flat[0], "+", color="#c8553d", markersize=12)
    measure(
        axes, (-FINGER.tip, half), (-FINGER.tip, -half), f"{FINGER.width:g}", (-5, 0)
    )
    measure(
        axes,
        (-FINGER.tip, -half),
        (-flat[2], -half),
        f"{FINGER.tip - flat[2]:.1f}",
        (0, -4),
    )
    measure(
        axes,
        (-FINGER.tip, half),
        (-FINGER.end, half),
        f"{FINGER.tip - FINGER.end:.1f}",
        (0, 4),
    )


def save(path: Path, size: tuple[float, float], *panels: tuple[str, Painter]) -> None:
    """Draw each panel below the one before it, with its title, as PNG."""
    figure, all_axes = plt.subplots(
        len(panels), 1, figsize=size, facecolor="white", squeeze=False
    )
    for axes, (title, paint) in zip(all_axes[:, 0], panels, strict=True):
        paint(axes)
        axes.set_aspect("equal")
        axes.autoscale_view()
        axes.margins(0.09)
        axes.set_axis_off()
        axes.set_title(title, fontsize=10, loc="left")
    figure.tight_layout()
    figure.savefig(path, dpi=110)
    plt.close(figure)


def view(
    parts: dict[str, Manifold], labels: Sequence[str] | None = None, *, tilt: float = 16
) -> Painter:
    """Return what draws parts from aside, ``tilt`` degrees from above; the finger lies,
    its tip to the left."""
    across, down = np.radians(62), np.radians(tilt)
    right = np.array([-np.cos(across), 0, -np.sin(across)])
    away = np.array(
        [-np.sin(across) * np.cos(down), -np.sin(down), np.cos(across) * np.cos(down)]
    )
    away /= np.linalg.norm(away)
    return lambda axes: draw(
        axes, parts, away, right, labels=list(parts) if labels is None else labels
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        description="draw both fingertips from their parts"
    )
    images = Path(__file__).parent.parent / "docs" / "images"
    parser.add_argument(
        "folder", nargs="?", type=Path, default=images, help="where the pictures go"
    )
    folder = parser.parse_args().folder
    whole = robot()
    save(folder / "finger-exploded.png", (9, 6.5), ("", view(exploded(whole))))
    save(folder / "finger-assembled.png", (7, 4), ("", view(whole, (), tilt=-12)))
    save(
        folder / "finger-dimensions.png",
        (8, 9),
        ("cut along the middle, mm", cut_with_dimensions),
        ("from below, mm", below_with_dimensions),
    )
    save(
        folder / "finger-glue.png",
        (6, 5),
        ("", view(upright(apart(whole, {"ring": -26, "piezo disc": -12})))),
    )
    poured = whole | {"pouring jig": in_the_finger("pouring_jig")}
    poured = {
        name: poured[name]
        for name in ("pouring jig", "pad", "piezo disc", "ring", "phalanx")
    }
    lifted = apart(
        poured, dict.fromkeys(("pad", "piezo disc", "ring"), -20) | {"phalanx": -42}
    )
    save(
        folder / "finger-pour.png",
        (6, 5),
        ("", view(upright(lifted), ("pouring jig", "ring", "phalanx"))),
    )
    mounted = whole | {
        "MEMS board": whole["MEMS board"].translate(tuple(8 * BOARD.out)),
        "stick adapter": whole["stick adapter"].translate((0, 0, -20)),
    }
    save(
        folder / "finger-board.png",
        (6, 3.6),
        ("", view(mounted, ("MEMS board", "stick adapter"))),
    )
    on_the_bench = tuple(
        (
            "",
            view(pad_up(whole | {name: in_the_finger(part)}), (name,)),
        )
        for name, part in (("ball guide", "ball_guide"), ("weight yoke", "weight_yoke"))
    )
    save(folder / "finger-bench.png", (6, 9), *on_the_bench)
    save(folder / "coil-case.png", (8, 4), ("", view(operator(5))))


def apart(parts: dict[str, Manifold], shifts: dict[str, float]) -> dict[str, Manifold]:
    """Shift the named parts along the pad's axis, in mm; leave out parts of a glued pad
    that are not named."""
    shown = (
        {"pad": 0.0, **shifts}
        if "pouring jig" not in parts
        else {name: shifts.get(name, 0.0) for name in parts}
    )
    return {
        name: parts[name].translate(tuple(by * FINGER.axis))
        for name, by in shown.items()
    }


def pad_up(parts: dict[str, Manifold]) -> dict[str, Manifold]:
    """Turn the finger so that the pad looks up, as on the bench."""
    return {
        name: part.rotate((FINGER.lean + 180, 0, 0)) for name, part in parts.items()
    }


def upright(parts: dict[str, Manifold]) -> dict[str, Manifold]:
    """Turn the finger by the pad's lean, so that the pad looks down."""
    return {name: part.rotate((FINGER.lean, 0, 0)) for name, part in parts.items()}


if __name__ == "__main__":
    main()
