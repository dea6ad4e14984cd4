"""``tactophone record``: the takes of one object, recorded into a data set, each
checked as it ends."""

from collections.abc import Callable
from contextlib import closing

from tactophone.app.sources import AudioInput, SimulatedAct
from tactophone.core.recordings.metadata import manifests_in, read_to_rewrite
from tactophone.core.recordings.values import Recording
from tactophone.core.settings import Settings
from tactophone.core.types import AudioBlock, ignore
from tactophone_lab.datasets.open import open_dataset, refuse_to_hide
from tactophone_lab.recording.protocol import Key, Stage
from tactophone_lab.recording.safe_writer import recording_in, recover
from tactophone_lab.recording.sound_taker import SoundTaker
from tactophone_lab.recording.take_recorder import RecordedObject, Recorder, SessionPlan


def record_object(
    settings: Settings,
    target: RecordedObject,
    plan: SessionPlan,
    *,
    key: Callable[[], Key | None] | None = None,
    follow: Callable[[Recorder, AudioBlock], None] | None = None,
    report: Callable[[str], None] = ignore,
) -> list[Recording]:
    """Record the takes that the data set lacks; return those finished.

    - ``key``: returns what was pressed since the block before; called in a thread of
      its own. Without it, and where no person takes part, each take is started and kept
      at once.
    - ``follow``: called after each block, to show the recorder.
    - ``report``: called with what people should know.

    Takes that a killed process left unfinished are finished first. Raises
    `DatasetError` if the disk is full, no recorded sound is lost; and before it records
    if something in ``metadata.csv`` is not understood, or the folder has recordings and
    no ``metadata.csv``.
    """
    with recording_in(plan.root):
        read_to_rewrite(plan.root)
        for recovered in recover(plan.root):
            report(
                f"finished {recovered.path}, which was cut off: "
                f"{recovered.known('quality')}"
            )
        refuse_to_hide(plan.root)
        known = open_dataset(plan.root) if manifests_in(plan.root) else None
        with AudioInput(settings, target.name) as audio:
            rate = audio.source.sample_rate
            channels = audio.source.channels
            recorder = Recorder(
                target,
                plan,
                known,
                sample_rate=rate,
                channels=channels,
                device_losses=lambda: audio.device_losses,
            )
            count = len(recorder.protocol.takes)
            report(
                f"{count} takes to record"
                if count
                else "all takes are recorded already"
            )
            alone = key is None or audio.simulated
            sound = SoundTaker(audio, key or ignore, ahead=not audio.simulated)
            with sound, closing(recorder):
                for block, pressed in sound:
                    if not alone and pressed:
                        recorder.press(pressed)
                    elif alone and not sound.waiting:
                        _press_go(recorder, audio, plan)
                    recorder.push(block)
                    if follow is not None:
                        follow(recorder, block)
                    if recorder.protocol.stage is Stage.DONE:
                        break
    return recorder.recordings


def _press_go(recorder: Recorder, audio: AudioInput, plan: SessionPlan) -> None:
    """Start each take and keep it, as a person does who accepts every take."""
    if recorder.protocol.stage is Stage.REVIEW:
        recorder.press(Key.GO)
    if recorder.protocol.stage is Stage.READY:
        recorder.press(Key.GO)
        # The simulated person starts at once, so that the countdown is over when the
        # stroke is under way.
        audio.ask(
            SimulatedAct(
                "take", plan.duration + plan.countdown, take=recorder.protocol.take.name
            )
        )
