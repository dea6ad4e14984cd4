import json
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

from tactophone import Touch
from tactophone.core.recordings.values import Recording
from tactophone_lab.evaluation.predict import TakePredictions
from tactophone_lab.evaluation.scores import make_report


def predicted(
    surface: str,
    label: Touch,
    *,
    rough: list[float],
    none: float = 0.0,
    contact: int = 1,
) -> TakePredictions:
    share = np.array(rough) * (1 - none)
    rows = np.stack(
        [np.full(len(rough), none), 1 - none - share, share], axis=1
    ).astype(np.float32)
    gate = np.full(len(rough), bool(contact))
    return TakePredictions(
        Recording(Path(f"{surface}.wav"), surface, label),
        np.arange(float(len(rough))),
        rows,
        gate,
    )


def made() -> list[TakePredictions]:
    return [
        predicted("slate", Touch.ROUGH, rough=[0.9, 0.8, 0.7, 0.2]),
        predicted("brick", Touch.ROUGH, rough=[0.9, 0.8, 0.7, 0.6], none=0.5),
        predicted("glass", Touch.SMOOTH, rough=[0.1, 0.2, 0.6, 0.3]),
        predicted("steel", Touch.SMOOTH, rough=[0.1] * 4, contact=0),
    ]


def test_a_surface_is_scored_as_rendered_and_by_single_windows() -> None:
    report = make_report(made(), draws=20)
    rows = {row.name: row for row in report.by_surface}
    assert rows["slate"].windows_right == 0.75
    # Evidence needs several windows, a second apart here, and so no touch is rough.
    assert rows["slate"].right == 0.0
    assert rows["glass"].right == 1.0
    assert report.windows["rough_accuracy"].value == pytest.approx(7 / 8)


def test_windows_are_scored_whatever_the_gate_reports() -> None:
    report = make_report(made(), draws=20)
    steel = next(row for row in report.by_surface if row.name == "steel")
    assert (steel.updates, steel.contact) == (4, 0.0)
    assert steel.windows_right == 1.0
    assert steel.right == 0.0
    # As rendered, a gate that never opens is a gap, and a gap is wrong.
    assert report.rendered.gaps.value == 0.25
    assert report.rendered.smooth_as_smooth.value == pytest.approx(4 / 8)
    assert (report.recordings, report.surfaces, report.updates, report.contact) == (
        4,
        4,
        16,
        0.75,
    )


def test_it_can_be_written_as_json() -> None:
    loaded = json.loads(json.dumps(asdict(make_report(made(), draws=20))))
    assert loaded["windows"]["auc"].keys() == {"value", "low", "high"}
    assert [row["name"] for row in loaded["by_recording"]] == [
        "slate.wav",
        "brick.wav",
        "glass.wav",
        "steel.wav",
    ]
