"""Opens the pipelines and calibrations that the settings name."""

import math
from pathlib import Path

from tactophone.haptics import PASSTHROUGH, GateProfile, Limits, open_profile
from tactophone.perception import (
    Calibration,
    default_model,
    model_path,
    open_detector,
    read_model,
    tip_mismatch,
    with_fallback,
)
from tactophone.pipeline import Pipeline, open_events
from tactophone.runtime.device_wiring import actuator_response
from tactophone.settings import Settings
from tactophone.types import LIVE_SAMPLE_RATE, Detector


def open_pipeline_for(settings: Settings, *, channels: int) -> Pipeline:
    """Open the pipeline for so many channels, with the model and profile that the settings name.

    Its detector falls back safely when a microphone is faulty, unless the settings say otherwise.
    """
    chosen, profile = settings.detector, settings.rendering.profile
    model = chosen.model or default_model(settings.capture.tip)
    calibration = read_calibration(chosen.calibration, channels)
    detector: Detector
    detector = plain = open_detector(model, sample_rate=LIVE_SAMPLE_RATE, follow_floor=True)
    if chosen.check_microphones:
        reference = calibration.reference if calibration else None
        detector = with_fallback(
            plain, sample_rate=LIVE_SAMPLE_RATE, channels=channels, model=model, reference=reference
        )
    if not math.isnan(chosen.threshold_dbfs):
        detector.threshold.dbfs = chosen.threshold_dbfs
    elif calibration and (level := calibration.threshold_for(plain.detector.card.gate.rule)) is not None:
        # A model whose rule was not calibrated follows the noise floor.
        detector.threshold.dbfs = level
    return Pipeline(
        detector,
        GateProfile(profile) if profile in PASSTHROUGH else open_profile(profile, actuator_response(settings)),
        Limits(ceiling=settings.rendering.ceiling),
        events=open_events(sample_rate=LIVE_SAMPLE_RATE, channels=channels, tip=settings.capture.tip)
        if chosen.events or profile == "events"
        else None,
    )


def tip_warning(settings: Settings) -> str:
    """Return what is wrong if the model is for another tip than the settings name; empty otherwise."""
    tip = settings.capture.tip
    return tip_mismatch(read_model(model_path(settings.detector.model or default_model(tip))).card, tip)


def read_calibration(path: str, channels: int) -> Calibration | None:
    """Read the calibration at ``path``; none if the path is empty or the number of microphones differs."""
    if not path:
        return None
    calibration = Calibration.read(Path(path).expanduser())
    return calibration if calibration.channels == channels else None
