"""False touches through the hand: how often a finger in the air is rendered as touching while its neighbours stroke.

    python benchmarks/hand.py [--seconds 30]

Simulated: three fingers, of which the first strokes five stones, and the other two hover. The level at which the
structure carries a contact to the next finger is swept, as no published figure for a robot's hand was found.
"""

import argparse
import math

import numpy as np

from tactophone.pipeline import Hand, open_pipeline
from tactophone.simulation import STRUCTURE_DB, Script, SimulatedFinger, SimulatedHand, five_stones, shuffled
from tactophone.simulation.content.movement import Visit, explore
from tactophone.types import LIVE_SAMPLE_RATE, Touch

LEVELS = (-math.inf, -40.0, -32.0, STRUCTURE_DB, -20.0, -14.0)
BLOCK = 480


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=30.0)
    seconds = parser.parse_args().seconds
    print("| structure, dB | next finger: false touches / min | time rendered as touching | the one after | "
          "the stroking finger: touches found |")  # fmt: skip
    print("|--:|--:|--:|--:|--:|")
    for level in LEVELS:
        own, following, after = run(level, seconds)
        rate, share = following
        print(f"| {level:g} | {60 * rate / seconds:.1f} | {share:.2%} | {after[1]:.2%} | {own:.0%} |", flush=True)


def run(level: float, seconds: float) -> tuple[float, tuple[int, float], tuple[int, float]]:
    """Return the share of true contact that is found, and false touches and their share of time of the two others."""
    scene = five_stones(shuffled(0))
    place = scene.placed[0].centre
    hand = SimulatedHand([SimulatedFinger(scene, seed=k, place=place) for k in range(3)], structure_db=level)
    script = Script(np.random.default_rng(0), x=place[0], y=place[1])
    stones = iter(range(10**6))
    while script.time < seconds:
        explore(script, scene.placed[next(stones) % 5], Visit(2.0, 1.8, 0.1))
    for move in script.moves:
        hand.fingers[0].move(move.x, move.y, move.force, move.time)
    pipelines = Hand([open_pipeline(sample_rate=LIVE_SAMPLE_RATE, channels=2) for _ in range(3)])
    touching = [False] * 3
    found, true, begun, lasted = 0, 0, [0] * 3, [0] * 3
    blocks = round(seconds * LIVE_SAMPLE_RATE / BLOCK)
    for _ in range(blocks):
        block = hand.render(BLOCK)
        for step in pipelines.push(block):
            if step.predictions:
                now = step.predictions[-1].touch is not Touch.NONE
                begun[step.finger] += now and not touching[step.finger]
                touching[step.finger] = now
            lasted[step.finger] += touching[step.finger]
        if hand.fingers[0].truth.object_index[-1] >= 0:
            true, found = true + 1, found + touching[0]
    return found / max(1, true), (begun[1], lasted[1] / blocks), (begun[2], lasted[2] / blocks)


if __name__ == "__main__":
    main()
