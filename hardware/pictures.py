"""Draws both fingertips, exploded and assembled, for docs/images. ``python hardware/pictures.py [FOLDER]``."""

import argparse
from pathlib import Path

import matplotlib as mpl

mpl.use("agg")
import matplotlib.pyplot as plt
import numpy as np
from fingertip import Bracket, CoilCase, Finger, adapter_to_stick, triangles
from manifold3d import Manifold
from matplotlib.collections import PolyCollection

LIGHT = np.array([0.5, -0.55, 0.67])
"""Direction of the light, in the picture's axes: x right, y away, z up."""

COLOURS = {
    "pad": "#4c8ed9",
    "piezo disc": "#d9a441",
    "silicone bed": "#d8d4cc",
    "phalanx": "#8a93a1",
    "microphone bracket": "#5aa36f",
    "MEMS capsule": "#c8553d",
    "stick adapter": "#b9a6d3",
    "case": "#4c8ed9",
    "voice coil": "#d9a441",
    "lid": "#8a93a1",
}


def robot_parts(spread: float) -> dict[str, Manifold]:
    """Return the robot's fingertip in the finger's coordinates, pulled apart by ``spread`` mm."""
    finger, bracket = Finger(), Bracket()
    disc = Manifold.cylinder(0.5, finger.disc / 2).rotate((-90, 0, 0)).translate((0, finger.seat, finger.disc_centre))
    port = bracket.distance, bracket.lift + finger.touching, finger.disc_centre
    capsule = Manifold.cylinder(6, 3).rotate((-90, 0, 0)).translate(port)
    adapter = adapter_to_stick(finger)
    top = adapter.bounding_box()[5]
    adapter = adapter.translate((0, finger.socket_height, -4 - top))
    return {
        "pad": finger.pad().translate((0, -4.6 * spread, 0)),
        "piezo disc": disc.translate((0, -3.4 * spread, 0)),
        "silicone bed": finger.silicone().translate((0, -2.0 * spread, 0)),
        "phalanx": finger.phalanx(),
        "microphone bracket": bracket.solid(finger).translate((0, 0, -4.2 * spread)),
        "MEMS capsule": capsule.translate((0, -1.5 * spread, -4.2 * spread)),
        "stick adapter": adapter.translate((0, 0, -5.6 * spread)),
    }


def operator_parts(spread: float) -> dict[str, Manifold]:
    """Return the operator's case in its coordinates, pulled apart by ``spread`` mm."""
    case = CoilCase()
    coil = Manifold.cube((case.width, case.height, case.length), center=True).translate((0, 0, case.length / 2 + 1.6))
    lid = case.lid().rotate((180, 0, 0)).translate((0, 0, case.length + 3.5))
    return {
        "case": case.case(),
        "voice coil": coil.translate((0, 0, 2.2 * spread)),
        "lid": lid.translate((0, 0, 5.5 * spread)),
    }


def draw(parts: dict[str, Manifold], path: Path, *, labels: bool) -> None:
    """Draw the parts lying, the finger pointing left and the side that touches facing down, as PNG."""
    turn, tilt = np.radians(62), np.radians(24)
    away = np.array([np.cos(turn) * np.cos(tilt), np.sin(turn) * np.cos(tilt), -np.sin(tilt)])
    right = np.array([np.sin(turn), -np.cos(turn), 0.0])
    up = np.cross(right, away)
    surfaces, spots = [], {}
    for name, part in parts.items():
        # Printed upright, along z; drawn lying: -z right, x towards the viewer, y up.
        faces = triangles(part.refine_to_length(0.4))[:, :, [2, 0, 1]] * [-1, -1, 1]
        normals = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
        seen = normals @ away < 0
        shade = 0.45 + 0.55 * np.clip(normals[seen] @ LIGHT / np.linalg.norm(LIGHT), 0, 1)
        surfaces.append((faces[seen], np.array(mpl.colors.to_rgb(COLOURS[name])) * shade[:, None]))
        flat = np.stack([faces.reshape(-1, 3) @ right, faces.reshape(-1, 3) @ up], axis=1)
        spots[name] = (flat.min(axis=0), flat.max(axis=0))
    faces = np.concatenate([surface for surface, _ in surfaces])
    colours = np.concatenate([colour for _, colour in surfaces])
    far_first = np.argsort(-(faces @ away).mean(axis=1))
    flat = np.stack([faces @ right, faces @ up], axis=-1)[far_first]
    low, high = flat.reshape(-1, 2).min(axis=0) - 6, flat.reshape(-1, 2).max(axis=0) + 6
    figure = plt.figure(figsize=tuple((high - low) / 13), facecolor="white")
    axes = figure.add_axes((0, 0, 1, 1))
    axes.add_collection(
        PolyCollection(flat, facecolors=colours[far_first], edgecolors=colours[far_first], linewidths=0.4)
    )
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
    axes.set_axis_off()
    for name, (least, most) in spots.items() if labels else ():
        below = name in ("pad", "case")
        place = (least[0] + most[0]) / 2, least[1] - 4 if below else most[1] + 1.5
        axes.text(*place, name, ha="center", fontsize=12, color="#222222")
    figure.savefig(path, dpi=100)
    plt.close(figure)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="draw both fingertips from their parts")
    images = Path(__file__).parent.parent / "docs" / "images"
    parser.add_argument("folder", nargs="?", type=Path, default=images, help="where the pictures go")
    folder = parser.parse_args().folder
    draw(robot_parts(10), folder / "finger-exploded.png", labels=True)
    draw(robot_parts(0), folder / "finger-assembled.png", labels=False)
    draw(operator_parts(5), folder / "coil-case.png", labels=True)
