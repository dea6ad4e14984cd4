"""What `--tip stylus` makes of sound that is no touch: speech, rain, a keyboard, claps;
and when it says so.

    python benchmarks/no_touch.py [MODEL] [--seconds 60] [--draws 1]
    python benchmarks/no_touch.py MODEL --fit SIMULATED ... [--beside RANDOM ...]

Each sound follows a second of a room's noise at -65 dBFS; its loudest second has -20
dBFS. It runs through the live pipeline, whose gate follows the noise floor. Printed are
the share of the time that is rendered rough, the onsets of rough in a minute, and the
second at which the notice comes. Speech is espeak-ng's, in three languages; where that
is not installed, a line says so. Rain, keyboard and claps are made here, in other ways
than for training (`no_touch_sounds.py`); the generated voice is training's, from
another seed.

``--fit`` fits what tells them from touch on the training sounds, on `lmt` and on
SIMULATED sets, prints how much of no touch counts as touch, and writes the weights into
the card of MODEL, a file of the recipe ``texture`` (needs TACTOPHONE_RECORDINGS).
``--beside`` names sets that MODEL learnt from too, which its features depend on, but
whose touch is left out of the fit: among many objects drawn at random one sounds like
rain, and the limit is the highest that any kind of rough needs.
"""

import argparse
import io
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import soundfile
from numpy.typing import NDArray
from scipy import signal

from no_touch_sounds import (
    LEAD_SECONDS,
    NO_TOUCH_RATE,
    SOUNDS,
    draw_no_touch,
    over_noise,
)
from rendered_real import OPTIONS, read_real
from tactophone.core.recordings.values import Recording, Segment
from tactophone.core.types import AudioBlock, FloatArray, Touch
from tactophone.signal.perception.models import model_path
from tactophone.signal.perception.no_touch import NO_TOUCH
from tactophone.signal.pipeline import open_pipeline
from tactophone_lab.datasets.open import open_dataset
from tactophone_lab.datasets.splits import kin_of
from tactophone_lab.training.baselines import FeatureRecipe
from tactophone_lab.training.onnx_export import add_settings
from tactophone_lab.training.recipes import RECIPES, configure
from tactophone_lab.training.sets import Examples, TrainingSet, inner_folds
from tactophone_lab.training.tracks import extract_features, noise_level

RATE = 48_000

SPOKEN = {
    "en-us": "The quick brown fox jumps over the lazy dog. She sells sea shells by "
    "the sea shore. Please lift the box, "
    "turn it around, and put it back on the table. Nobody was there to hear what the "
    "robot had touched that morning.",
    "de": "Zwölf Boxkämpfer jagen Viktor quer über den großen Sylter Deich. Bitte "
    "heben Sie die Kiste an, drehen Sie "
    "sie um und stellen Sie sie zurück auf den Tisch. Niemand war da, der hörte, was "
    "der Roboter berührt hatte.",
    "fr-fr": "Portez ce vieux whisky au juge blond qui fume. Soulevez la boîte, "
    "tournez-la et remettez-la sur la "
    "table. Personne n'était là pour entendre ce que le robot avait touché ce matin.",
}

Floats = NDArray[np.float64]


OTHERS = {
    "es+m1": "El veloz murciélago hindú comía feliz cardillo y kiwi mientras tocaba "
    "el saxofón detrás del palenque.",
    "it+f2": "Quel vituperabile xenofobo zelante assaggia il whisky ed esclama: "
    "alleluja, che bella giornata di sole.",
    "sv+m3": "Flygande bäckasiner söka hwila på mjuka tuvor, och yxskaftbud ge vår "
    "wc-zonmö iq-hjälp hela dagen.",
    "pl+f3": "Pchnąć w tę łódź jeża lub ośm skrzyń fig, a potem szybko wrócić do domu "
    "przez las.",
    "ru+m5": "Съешь же ещё этих мягких французских булок, да выпей чаю, а потом "
    "расскажи мне всё.",
    "hi+f4": "ऋषियों को सताने वाले दुष्ट राक्षसों के राजा रावण का सर्वनाश करने वाले श्रीराम.",
    "pt+m7": "Luís argüia à Júlia que brações, fé, chá, óxido, pôr, zângão eram "
    "palavras do português.",
    "nl+f1": "Pa's wijze lynx bezag vroom het fikse aquaduct, en daarna gingen we "
    "samen naar de markt.",
}
"""Other languages and voices, to train with."""


def spoken(language: str, seconds: float) -> Floats:
    """Return the text of a language as espeak-ng says it, repeated."""
    command = ["espeak-ng", "-v", language, "--stdout", (SPOKEN | OTHERS)[language]]
    said = subprocess.run(command, capture_output=True, check=True).stdout
    # espeak-ng writes no length into a header that goes to a pipe.
    samples = (
        np.frombuffer(said[44:], "<i2") / 32_768
        if said[:4] == b"RIFF"
        else soundfile.read(io.BytesIO(said))[0]
    )
    sound = signal.resample_poly(samples, RATE, 22_050)
    return np.resize(sound, int(seconds * RATE))


def patter(seconds: float, draw: int = 0) -> Floats:
    """Rain on a window: impulses at random, through twelve modes of a plate."""
    rng = np.random.default_rng(1 + 10 * draw)
    drops = rng.lognormal(0, 0.7, int(seconds * RATE)) * (
        rng.random(int(seconds * RATE)) < 60 / RATE
    )
    modes = rng.uniform(300, 9000, 12)
    found = sum(
        signal.lfilter(*signal.iirpeak(mode, mode / 150, RATE), drops) for mode in modes
    )
    return np.asarray(found, np.float64)


def typing(seconds: float, draw: int = 0) -> Floats:
    """A keyboard: bursts of 8 ms of noise over 1 kHz, eight keys a second in words of
    one to nine."""
    rng, found, at = (
        np.random.default_rng(2 + 10 * draw),
        np.zeros(int(seconds * RATE)),
        0.2,
    )
    high = signal.butter(2, 1000, "high", fs=RATE, output="sos")
    while at < seconds - 0.1:
        for _ in range(rng.integers(1, 10)):
            burst = signal.sosfilt(
                high,
                rng.standard_normal(1200) * np.exp(-np.arange(1200) / (0.003 * RATE)),
            )
            place = min(int(at * RATE), len(found) - 1200)
            found[place : place + 1200] += rng.uniform(0.3, 1) * burst
            at += rng.uniform(0.08, 0.18)
        at += rng.uniform(0.1, 0.8)
    return found


def applause(seconds: float, draw: int = 0) -> Floats:
    """One person who claps twice a second, in a room of 0.3 s."""
    rng, size = np.random.default_rng(3 + 10 * draw), int(seconds * RATE)
    claps = np.zeros(size)
    claps[
        (
            np.arange(0.1, seconds - 0.1, 0.5) * RATE
            + rng.integers(0, 2000, int((seconds - 0.2) * 2) + 1)[
                : len(np.arange(0.1, seconds - 0.1, 0.5))
            ]
        ).astype(int)
    ] = 1
    time = np.arange(int(0.3 * RATE)) / RATE
    room = rng.standard_normal(len(time)) * (
        np.exp(-time / 0.003) + 0.15 * np.exp(-time / 0.045)
    )
    band = signal.butter(1, (500, 6000), "bandpass", fs=RATE, output="sos")
    return np.asarray(signal.sosfilt(band, signal.fftconvolve(claps, room)[:size]))


def sounds(seconds: float, draws: int = 1) -> Iterator[tuple[str, Floats]]:
    if shutil.which("espeak-ng"):
        for language in SPOKEN:
            yield f"speech, {language}", spoken(language, seconds)
    else:
        print(
            "espeak-ng is not installed (apt install espeak-ng): speech is the "
            "generated voice alone",
            file=sys.stderr,
        )
    voice = draw_no_touch("voice", seconds, 100, lead=0)[:, 0].astype(float)
    yield "generated voice", signal.resample_poly(voice, RATE, NO_TOUCH_RATE)
    for name, made in (("rain", patter), ("keyboard", typing), ("claps", applause)):
        for draw in range(draws):
            yield f"{name} {draw + 1}" if draw else name, made(seconds, draw)


def measure(sound: Floats, model: str = "stylus") -> tuple[float, float, str, float]:
    """Return the share of rough, its onsets a minute, the notice's code, and when it
    came in s, of one sound."""
    lead = np.zeros(RATE)
    samples = over_noise(np.concatenate((lead, sound)), RATE, np.random.default_rng(0))
    pipeline = open_pipeline(model, sample_rate=RATE, channels=1, tip="stylus")
    rough, code, noticed = np.zeros(len(samples) // 480, bool), "", np.inf
    for number in range(len(rough)):
        block = AudioBlock(
            samples[480 * number : 480 * (number + 1)], RATE, 480 * number
        )
        step = pipeline.push(block)
        rough[number] = (
            step.predictions[-1].touch is Touch.ROUGH
            if step.predictions
            else rough[number - 1]
        )
        misfit = getattr(pipeline.detector, "misfit", None)
        if misfit and not code:
            code, noticed = misfit.code, number / 100 - 1
    onsets = int((np.diff(rough.astype(int), prepend=0) > 0).sum())
    return float(rough[100:].mean()), 60 * onsets / (len(sound) / RATE), code, noticed


OF_TOUCH = 0.02
"""Share of the windows of any kind of rough, held out, that may count as no touch."""

PENALTY = 0.02


def no_touch_features(
    training_set: TrainingSet, folder: Path
) -> tuple[FloatArray, NDArray[np.intp]]:
    """Return the features of the training sounds, varied as takes are, and the number
    of each window's sound."""
    takes = []
    for name in SOUNDS:
        for seed in range(8):
            path, seconds = folder / f"{name}-{seed}.wav", 6.0
            if not path.exists():
                soundfile.write(
                    path,
                    draw_no_touch(name, seconds, seed),
                    NO_TOUCH_RATE,
                    subtype="FLOAT",
                )
            segments = (
                Segment(0, LEAD_SECONDS, "none"),
                Segment(LEAD_SECONDS, LEAD_SECONDS + seconds, "contact"),
            )
            takes.append(Recording(path, name, None, ("air",), segments=segments))
    if not shutil.which("espeak-ng"):
        raise SystemExit(
            "espeak-ng is not installed, and what tells speech from touch is fitted "
            "to it: apt install espeak-ng"
        )
    for number, voice in enumerate(OTHERS):
        path, seconds = folder / f"speech-{number}.wav", 8.0
        sound = np.append(np.zeros(RATE // 2), spoken(voice, seconds))
        if not path.exists():
            soundfile.write(
                path,
                over_noise(sound, RATE, np.random.default_rng(number)),
                RATE,
                subtype="FLOAT",
            )
        segments = (
            Segment(0, LEAD_SECONDS, "none"),
            Segment(LEAD_SECONDS, LEAD_SECONDS + seconds, "contact"),
        )
        takes.append(Recording(path, "speech", None, ("air",), segments=segments))
    spec = training_set.spec
    tracks = extract_features(takes, spec)
    augmentation = RECIPES["texture"].augmentation
    for copy in range(1, 4):
        tracks = tracks + extract_features(
            takes, replace(spec, augmentation=augmentation, copy=(0, copy))
        )
    masks = [track.touching() & track.loud(noise_level([track])) for track in tracks]
    rows = [
        each[mask]
        for each, mask in zip(training_set.features(tracks), masks, strict=True)
    ]
    names = [*SOUNDS, "speech"]
    kinds = [names.index(track.recording.surface) for track in tracks]
    return np.concatenate(rows), np.repeat(kinds, [len(each) for each in rows])


def fit(
    training_set: TrainingSet, folder: Path, touch: Examples
) -> tuple[FloatArray, float, float]:
    """Return weights and bias of no touch against these examples of touch, and the
    share of the training sounds that counts as touch."""
    from sklearn.linear_model import LogisticRegression

    # A simulated surface weighs as much as a real one here: neither may fall silent.
    touch = replace(touch.thinned(), importance=None)
    others, kind = no_touch_features(training_set, folder)
    others, kind = others[::2], kind[::2]
    centre, scale = touch.moments()
    whole = np.concatenate(
        (touch.standardised(centre, scale), (others - centre) / scale)
    )
    shares = np.concatenate(
        (
            touch.weights() / touch.weights().sum(),
            1 / np.bincount(kind)[kind] / len(np.unique(kind)),
        )
    )
    label = np.arange(len(whole)) >= len(touch.rough)

    def regression(rows: NDArray[np.bool_]) -> Floats:
        model = LogisticRegression(C=PENALTY, solver="newton-cholesky", max_iter=50)
        model.fit(whole[rows], label[rows], sample_weight=shares[rows] * len(whole) / 2)
        return np.append(model.coef_[0], model.intercept_[0])

    limits = []
    for out in inner_folds(touch.rough, touch.surface):
        fitted = regression(np.append(~out, np.ones(len(others), bool)))
        for number in np.unique(touch.surface[out & touch.rough]):
            rough = np.flatnonzero(out & touch.rough & (touch.surface == number))
            limits.append(
                np.quantile(whole[rough] @ fitted[:-1] + fitted[-1], 1 - OF_TOUCH)
            )
    limit = float(max(limits))
    fitted = regression(np.ones(len(whole), bool))
    missed = float((whole[label] @ fitted[:-1] + fitted[-1] < limit).mean())
    print(
        f"no touch that counts as touch, windows of training sounds: {missed:.3f}; "
        f"limit {limit:.2f}"
    )
    ready = fitted[:-1] / scale
    return np.float32(ready), float(fitted[-1] - limit - centre @ ready), missed


def recordings_of(folders: Sequence[Path]) -> list[Recording]:
    return [take for folder in folders for take in open_dataset(folder).recordings]


def fit_and_write(
    model: Path, folders: Sequence[Path], beside: Sequence[Path] = ()
) -> None:
    recipe = configure("texture", OPTIONS)
    assert isinstance(recipe, FeatureRecipe)
    left_out = recordings_of(beside)
    takes = [*read_real().recordings, *recordings_of(folders), *left_out]
    training_set = recipe.training_set(takes, codecs=recipe.codecs)
    # Kin are numbered in this order; see `build_training_set`.
    kin = sorted({kin_of(take) for take in takes})
    numbers = [kin.index(kin_of(take)) for take in left_out]
    examples = training_set.examples
    touch = examples.where(~np.isin(examples.surface, numbers))
    with tempfile.TemporaryDirectory() as folder:
        weights, bias, _ = fit(training_set, Path(folder), touch)
    add_settings(model, {NO_TOUCH: {"weights": weights.tolist(), "bias": bias}})


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "model", nargs="?", default="stylus", help="default: %(default)s"
    )
    parser.add_argument(
        "--seconds", type=float, default=60.0, help="of each sound (default: 60)"
    )
    parser.add_argument(
        "--draws", type=int, default=1, help="of rain, keyboard and claps"
    )
    parser.add_argument(
        "--fit",
        type=Path,
        nargs="+",
        metavar="SIMULATED",
        help="fit on these sets, and write into MODEL's card",
    )
    parser.add_argument(
        "--beside",
        type=Path,
        nargs="+",
        default=[],
        metavar="RANDOM",
        help="with --fit: sets that MODEL learnt from, left out of the fit",
    )
    args = parser.parse_args()
    if args.fit:
        fit_and_write(model_path(args.model), args.fit, args.beside)
        return
    print(
        "| sound | rough, share of the time | onsets of rough a minute | notice "
        "| notice after |\n|---|--:|--:|---|--:|"
    )
    for name, sound in sounds(args.seconds, args.draws):
        rough, onsets, code, noticed = measure(sound, args.model)
        print(
            f"| {name} | {rough:.3f} | {onsets:.0f} | {code or 'none'} | "
            f"{f'{noticed:.1f} s' if code else '-'} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
