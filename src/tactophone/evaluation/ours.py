"""Our own detector as a method that is cross-validated: the live stages, a whole recording at a time."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import onnxruntime

from tactophone.dataset import Recording
from tactophone.evaluation.judging import Judge, Judgement
from tactophone.perception.model import FEATURES, LOG_PROBABILITIES
from tactophone.training.headgraph import build_head_graph
from tactophone.training.texture import Lesson, TextureCourse, fit, prepare
from tactophone.training.touches import listen, remember

VERSION = 1
"""Raise it when the detector changes in a way that its settings do not tell, so that cached results are made anew."""


@dataclass(frozen=True, slots=True)
class TextureMethod:
    """Our own detector.

    Recordings are described once and remembered by the process, so that a fold costs the fitting of its head; tests
    hold this to be what the streaming detector says, window for window.
    """

    course: TextureCourse
    name: str = "ours"

    @property
    def identity(self) -> str:
        """The whole course, and the version of what is done with it."""
        return f"texture {VERSION} {self.course!r}"

    def fit(self, recordings: Sequence[Recording]) -> Judge:
        """Learn, and make the graph that a model file would hold."""
        lesson = prepare(self.course, recordings)
        graph = build_head_graph(fit(lesson, self.course), channels=self.course.channels)
        return judge_by(graph.SerializeToString(), lesson, self.course)


def judge_by(graph: bytes, lesson: Lesson, course: TextureCourse) -> Judge:
    """Make a judge of a head's graph; it answers for every window of a recording at once."""
    session = onnxruntime.InferenceSession(graph, providers=["CPUExecutionProvider"])

    def judge(recording: Recording) -> Judgement:
        (track,) = listen([recording], channels=course.channels, codec=course.codec)
        features = remember(track, lesson.threshold_dbfs).features(lesson.prior, track.present)
        (answer,) = session.run([LOG_PROBABILITIES], {FEATURES: features})
        contact = track.level_dbfs >= lesson.threshold_dbfs
        return Judgement(recording, track.end, np.exp(answer, dtype=np.float32), contact)

    return judge
