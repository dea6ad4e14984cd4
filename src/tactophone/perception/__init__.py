"""Sound to prediction: resample, window, extract features, classify, decide; and the health of the microphones."""

from tactophone.perception.batching import process_together
from tactophone.perception.contact import ContactGate
from tactophone.perception.decision import FORGET_AFTER, NEVER_ABSTAIN, Decision, DecisionRule
from tactophone.perception.detector import WindowDetector
from tactophone.perception.event_merging import EventMerger
from tactophone.perception.events import EventDetector
from tactophone.perception.features.bands import BAND_COUNT, BAND_VALUES, CREST_INDEX, BandFeatures
from tactophone.perception.features.extractors import EXTRACTORS, SUPPORTS_MISSING_CHANNEL
from tactophone.perception.features.handcrafted import CUES, cues
from tactophone.perception.features.loudness import LoudnessRule, banded_dbfs
from tactophone.perception.features.resample import Resampler
from tactophone.perception.features.spectrum import magnitudes
from tactophone.perception.features.texture import (
    MEMORY,
    MIN_VARIANCE,
    SILENT_POWER,
    ChangeMetric,
    Moments,
    RunningStatistics,
    fading_of,
    texture_features,
)
from tactophone.perception.model_file import CARD_KEY, FEATURES, LOG_PROBABILITIES, Gate, Model, ModelCard, read_model
from tactophone.perception.model_registry import (
    TIP_MODELS,
    default_model,
    fallback_model,
    model_path,
    open_detector,
    shipped_models,
    tip_mismatch,
    with_gate,
)
from tactophone.perception.noise_floor import HOLD, SILENT_DBFS, NoiseFloor
from tactophone.perception.recording_floor import RecordingFloor, measure_floor
from tactophone.perception.sensor_health.calibration_file import Calibration
from tactophone.perception.sensor_health.calibration_measurement import (
    CalibrationResult,
    CalibrationSounds,
    Finding,
    measure_calibration,
)
from tactophone.perception.sensor_health.fallback import (
    FALLBACK_MESSAGES,
    AnyTouchDetector,
    FallbackDetector,
    with_fallback,
)
from tactophone.perception.sensor_health.faults import MICROPHONES, FaultDetector, FaultKind, Reference, SensorFault
from tactophone.perception.sensor_health.invalid_samples import find_invalid
from tactophone.perception.sensor_health.signal_statistics import ChannelStatistics, SignalStatistics
from tactophone.perception.touch_detector import TouchDetector

__all__ = [
    "BAND_COUNT",
    "BAND_VALUES",
    "CARD_KEY",
    "CREST_INDEX",
    "CUES",
    "EXTRACTORS",
    "FALLBACK_MESSAGES",
    "FEATURES",
    "FORGET_AFTER",
    "HOLD",
    "LOG_PROBABILITIES",
    "MEMORY",
    "MICROPHONES",
    "MIN_VARIANCE",
    "NEVER_ABSTAIN",
    "SILENT_DBFS",
    "SILENT_POWER",
    "SUPPORTS_MISSING_CHANNEL",
    "TIP_MODELS",
    "AnyTouchDetector",
    "BandFeatures",
    "Calibration",
    "CalibrationResult",
    "CalibrationSounds",
    "ChangeMetric",
    "ChannelStatistics",
    "ContactGate",
    "Decision",
    "DecisionRule",
    "EventDetector",
    "EventMerger",
    "FallbackDetector",
    "FaultDetector",
    "FaultKind",
    "Finding",
    "Gate",
    "LoudnessRule",
    "Model",
    "ModelCard",
    "Moments",
    "NoiseFloor",
    "RecordingFloor",
    "Reference",
    "Resampler",
    "RunningStatistics",
    "SensorFault",
    "SignalStatistics",
    "TouchDetector",
    "WindowDetector",
    "banded_dbfs",
    "cues",
    "default_model",
    "fading_of",
    "fallback_model",
    "find_invalid",
    "magnitudes",
    "measure_calibration",
    "measure_floor",
    "model_path",
    "open_detector",
    "process_together",
    "read_model",
    "shipped_models",
    "texture_features",
    "tip_mismatch",
    "with_fallback",
    "with_gate",
]
