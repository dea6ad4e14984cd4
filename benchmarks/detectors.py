"""Processor time of the operator's detectors alone, by number of fingers, with their microphone checks.

    python benchmarks/detectors.py [--fingers 1,2,5,10] [--model texture] [--size 120]

Packets of 2.5 ms (120 samples) are pushed in a loop: without pauses, so caches are warm (in live use an update costs
two to three times as much: `live_compute.py`), and by processor time, the least of some runs, so that a busy machine
matters little.
"""

import argparse
import time

import numpy as np

from tactophone.perception import with_fallback
from tactophone.pipeline import Hand, Pipeline, open_pipeline
from tactophone.types import LIVE_SAMPLE_RATE, AudioBlock

DURATION = 6
RUNS = 5


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--fingers", default="1,2,5,10", help="numbers of fingers (default: 1,2,5,10)")
    parser.add_argument("--model", default="texture")
    parser.add_argument("--size", type=int, default=120, help="samples a block (default: 120)")
    args = parser.parse_args()
    print("| fingers | detectors, of one core |\n|--:|--:|")
    for fingers in map(int, args.fingers.split(",")):
        blocks = strokes(fingers, args.size)
        least = min(processor_time(blocks, [pipeline_of(args.model) for _ in range(fingers)]) for _ in range(RUNS))
        print(f"| {fingers} | {100 * least / DURATION:.1f} % |", flush=True)


def pipeline_of(model: str) -> Pipeline:
    pipeline = open_pipeline(model, sample_rate=LIVE_SAMPLE_RATE, channels=2)
    pipeline.detector = with_fallback(pipeline.detector, sample_rate=LIVE_SAMPLE_RATE, channels=2, model=model)
    return pipeline


def processor_time(blocks: list[AudioBlock], pipelines: list[Pipeline]) -> float:
    hand = Hand(pipelines)
    began = time.process_time()
    for block in blocks:
        for _ in hand.push(block):
            pass
    return time.process_time() - began


def strokes(fingers: int, size: int) -> list[AudioBlock]:
    """Return noise modulated like strokes, contact and air of each finger; half of the time there is contact."""
    time_s = np.arange(DURATION * LIVE_SAMPLE_RATE) / LIVE_SAMPLE_RATE
    strength = 0.1 * np.maximum(0, np.sin(2 * np.pi * time_s))[:, None] * np.tile([1, 0.1], fingers)
    samples = (np.random.default_rng(0).standard_normal(strength.shape) * strength).astype(np.float32)
    starts = range(0, len(samples) - size + 1, size)
    return [AudioBlock(samples[start : start + size], LIVE_SAMPLE_RATE, start) for start in starts]


if __name__ == "__main__":
    main()
