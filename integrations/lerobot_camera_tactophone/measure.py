"""Measure what survives LeRobot's video coding: ``python measure.py``, with ``pip
install scikit-learn av``.

A linear probe tells rough from smooth on pictures of surfaces that it was not trained
on, after AV1 (libsvtav1, 4:2:0, g 2, crf 30: the defaults of lerobot 0.4.4), against
the detector on the same sound. The sound is simulated. The rule: the probe's AUC is at
least 0.97 of the detector's.
"""

import io
import time

import av
import numpy as np
from lerobot_camera_tactophone.picture import BANDS, Picture
from sklearn.linear_model import RidgeClassifier
from sklearn.metrics import roc_auc_score
from sklearn.preprocessing import StandardScaler

from tactophone import Touch, open_pipeline
from tactophone_lab.simulation.catalogue import catalogue
from tactophone_lab.simulation.motion import single
from tactophone_lab.simulation.source import SimulatedFinger
from tactophone_lab.simulation.strokes import take_moves
from tactophone_lab.simulation.takes import TAKES

FPS, SECONDS, FOLDS = 30, 8.0, 5


def take(number: int, obj):
    """Return pictures, truth and the detector's roughness at each frame, and s that
    drawing took."""
    scene, rng = single(obj), np.random.default_rng(number)
    moves = take_moves(
        TAKES[number % len(TAKES)], scene.placed[0], duration=SECONDS, rng=rng
    )
    finger = SimulatedFinger(scene, moves, seed=number, place=scene.placed[0].centre)
    pipeline, picture = open_pipeline(sample_rate=48_000, channels=2), Picture()
    pictures, truth, rough, spent, felt = [], [], [], 0.0, 0.0
    for _ in range(round(SECONDS * FPS)):
        block = finger.render(48_000 // FPS)
        step = pipeline.push(block)
        begun = time.perf_counter()
        for prediction, command in zip(step.predictions, step.commands, strict=True):
            picture.feel(prediction, command.amplitude)
            felt = prediction.probabilities[2] / max(
                1e-9, prediction.probabilities[1] + prediction.probabilities[2]
            )
        picture.hear(block.samples)
        pictures.append(picture.rgb)
        spent += time.perf_counter() - begun
        truth.append(int(finger.truth.touch[-1]))
        rough.append(felt)
    return pictures, truth, rough, spent


def coded(pictures):
    """Return the pictures after LeRobot's default coding."""
    file = io.BytesIO()
    with av.open(file, "w", format="mp4") as output:
        stream = output.add_stream(
            "libsvtav1", FPS, options={"g": "2", "crf": "30", "preset": "12"}
        )
        stream.width = stream.height = pictures[0].shape[0]
        stream.pix_fmt = "yuv420p"
        for pixels in pictures:
            output.mux(
                stream.encode(av.VideoFrame.from_ndarray(pixels, format="rgb24"))
            )
        output.mux(stream.encode())
    file.seek(0)
    with av.open(file) as video:
        return [frame.to_ndarray(format="rgb24") for frame in video.decode(video=0)]


def features(pictures, rows):
    """Return means of blocks of 8 x 8 pixels of the newest half second."""
    grey = np.stack([pixels[:rows, -56:, 0] for pixels in pictures]).astype(float)
    return (
        grey.reshape(len(grey), rows // 8, 8, 7, 8).mean((2, 4)).reshape(len(grey), -1)
    )


def main() -> None:
    whole, sound, truth, rough, groups, spent, drawn = [], [], [], [], [], 0.0, 0
    for number, obj in enumerate(catalogue()):
        pictures, labels, felt, seconds = take(number, obj)
        decoded = coded(pictures)
        whole.append(features(decoded, 224))
        sound.append(features(decoded, 2 * BANDS))
        truth += labels
        rough += felt
        groups += [number] * len(labels)
        spent, drawn = spent + seconds, drawn + len(pictures)
    truth, rough, groups = np.array(truth), np.array(rough), np.array(groups)
    touching = truth != Touch.NONE
    for name, parts in (("whole picture", whole), ("sound alone", sound)):
        x, score = np.concatenate(parts), np.zeros(len(truth))
        for fold in range(FOLDS):
            held = (groups * 7 % FOLDS) == fold
            scaler = StandardScaler().fit(x[touching & ~held])
            probe = RidgeClassifier(alpha=1000).fit(
                scaler.transform(x[touching & ~held]), truth[touching & ~held] == 2
            )
            score[held] = probe.decision_function(scaler.transform(x[held]))
        probe_auc = roc_auc_score(truth[touching] == 2, score[touching])
        detector = roc_auc_score(truth[touching] == 2, rough[touching])
        surfaces = np.unique(groups)
        low, high = interval(touching, groups, truth, score, rough)
        words = (
            f"{name}: AUC {probe_auc:.3f}, detector {detector:.3f}, ratio "
            f"{probe_auc / detector:.3f}"
        )
        print(f"{words} ({low:.2f} to {high:.2f} over surfaces)")
    share = 100 * spent / drawn * FPS
    print(
        f"{len(surfaces)} surfaces, {int(touching.sum())} frames of contact; drawing: "
        f"{share:.1f} % of a core"
    )


def interval(touching, groups, truth, score, rough):
    """Return bounds of 95 % of the ratio of the two AUC, over surfaces drawn anew."""
    rng, surfaces, ratios = np.random.default_rng(0), np.unique(groups), []
    for _ in range(200):
        drawn = rng.choice(surfaces, len(surfaces))
        rows = np.concatenate(
            [np.flatnonzero(touching & (groups == number)) for number in drawn]
        )
        is_rough = truth[rows] == Touch.ROUGH
        if 0 < is_rough.sum() < len(rows):
            ratios.append(
                roc_auc_score(is_rough, score[rows])
                / roc_auc_score(is_rough, rough[rows])
            )
    return np.quantile(ratios, [0.025, 0.975])


if __name__ == "__main__":
    main()
