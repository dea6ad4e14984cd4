"""Open the source that the settings name: a device, a recording, or the simulated finger."""

from functools import partial

from tactophone.capture import CombinedSource, FileSource, RecordedSource
from tactophone.cli._support import extras
from tactophone.dataset import ground_truth, touch_at
from tactophone.errors import ConfigError
from tactophone.hand import each_finger
from tactophone.perception import Resampler
from tactophone.runtime import open_device
from tactophone.settings import Settings
from tactophone.types import LIVE_SAMPLE_RATE, Source


def open_source(settings: Settings) -> Source:
    """Open the source of ``settings.capture``; it delivers sound at the live sample rate.

    Raises `ConfigError` if the setting ``capture.device`` does not fit the source, and `DatasetError` if a recording is
    missing or damaged.
    """
    capture = settings.capture
    if settings.is_hand and capture.source in ("finger", "file"):
        return _hand(settings)
    if capture.source == "finger":
        from tactophone.simulation.demonstration import StrokingFinger

        return StrokingFinger(capture.block_size, seed=_seed(capture.device), tip=capture.tip)
    if capture.source == "ros":
        return _ros_source(capture.device)
    if capture.source != "file":
        return open_device(settings)
    if not capture.device:
        raise ConfigError("capture.source = 'file', but no file is named: give --device RECORDING")
    return recorded(FileSource(capture.device, block_size=capture.block_size, loop=capture.loop))


def _hand(settings: Settings) -> Source:
    """Open a simulated hand, or a recording for each finger."""
    capture, fingers = settings.capture, each_finger(settings)
    if capture.source == "finger":
        from tactophone.simulation.demonstration import StrokingHand

        return StrokingHand(len(fingers), capture.block_size, seed=_seed(capture.device), tip=capture.tip)
    for finger, own in zip(settings.fingers, fingers, strict=True):
        if not own.capture.device:
            raise ConfigError(
                f'no recording is named for the finger {finger.name}: write device = "FILE" under [{finger.name}]'
            )
    sources = [FileSource(own.capture.device, block_size=capture.block_size, loop=capture.loop) for own in fingers]
    return CombinedSource([recorded(source) for source in sources])


def recorded(source: FileSource) -> RecordedSource:
    """Return a recording as a live source, with the labels of the data set that it belongs to."""
    resampler = Resampler(source.sample_rate, LIVE_SAMPLE_RATE, channels=source.channels)
    truth = ground_truth(source.path, duration=source.duration)
    return RecordedSource(source, resample=resampler.push, label_at=partial(touch_at, segments=truth))


def _ros_source(topic: str) -> Source:
    """Open the microphones of a ROS 2 topic, at the live sample rate."""
    extras.require_modules("cyclonedds")
    from tactophone.bridges.ros import RosSource

    if not topic:
        raise ConfigError("capture.source = 'ros', but no topic is named: give --source ros:/TOPIC")
    source = RosSource(topic)
    if source.sample_rate != LIVE_SAMPLE_RATE:
        raise ConfigError(
            f"--source ros:{topic}: {source.sample_rate} Hz, but {LIVE_SAMPLE_RATE} Hz is needed; set its node so"
        )
    return source


def _seed(text: str) -> int:
    try:
        return int(text or 0)
    except ValueError:
        raise ConfigError(
            f"capture.device = {text!r}, but for the simulated finger it is a seed, a whole number"
        ) from None
