"""Touch events by sound: taps, strokes that begin and end, slip; a knock in the air is
no touch.

Contact microphones separate a finger's taps by their onset (VSkin, Sun et al., CHI
2018; Acustico, Gong et al., UIST 2020). Here an onset is a rise in 24 logarithmic bands
over the loudest neighbour two steps before (SuperFlux, Böck & Widmer, DAFx 2013),
against a threshold of median and deviation over the last half second: it looks at no
later sound. Bands count by their excess over their own noise floor, so that the gain
and the noise of a microphone do not matter. An onset is reported at once as *contact*,
and as a *tap* when the next 80 ms are over and it was no knock in the air.

What separates a touch-down from the bursts of sliding is that it comes out of rest:
before it the level is steady, as that of noise is and that of sliding is not; nearly
all of its excess rises within two steps, and it decays. And no other follows: grains
and meshes strike a sliding tip in trains, and a finger that bounces does so more
softly.

Sliding is an excess of all bands over the background for 30 ms. It begins a *stroke*,
or a *slip* if no touch-down was detected since the last sliding ended; its end is a
*lift-off*, unless it goes on soon. A finger that rests sounds like one that has left:
lift-off means that the sliding ended.
"""

from collections import deque
from collections.abc import Iterator

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from tactophone.core.microphones import AIR, CONTACT
from tactophone.core.tips import DEFAULT_TIP, TIPS
from tactophone.core.types import AudioBlock, FloatArray, Prediction, Touch, TouchEvent
from tactophone.signal.silences import SLIDE_HOLD

STEPS_PER_SECOND = 400
"""A step of 2.5 ms: an onset must be reported within 5 ms of the contact."""

BANDS = 24
"""Number of logarithmic bands."""

LOWEST = 200.0
"""Lower edge of the bands in Hz: what a window of two steps resolves."""

HIGHEST = 12_000.0
"""Upper edge of the bands in Hz."""

EVENT_POWER_FLOOR = 1e-12
"""Power a band counts at least as, -120 dB: digital silence has no finite level."""

RISE = 5.0
"""Speed in dB/s at which the noise floor of a band follows its level up: by 10 dB in a
stroke of 2 s."""

FALL = 15.0
"""Speed in dB/s at which it follows its level down: with `RISE` it settles where one
step in four is quieter."""

FLOOR_BIAS_DB = 2.0
"""A band's excess counts from so far over its floor: half way to the median of noise in
a band of one bin."""

EVENT_SETTLED = 40
"""Steps, 0.1 s, from which the floor is first taken: its quarter that is quietest."""

EVENT_HISTORY = 200
"""Steps, half a second, of the adaptive threshold."""

DEVIATIONS = 6.0
"""Mean absolute deviations by which an onset's flux exceeds the median."""

LEAST_FLUX_DB = 1.5
"""By how many dB an onset's flux exceeds the median at least."""

DECAYED_AFTER = 10
"""Steps, 25 ms, after an onset in which a tap decays."""

CLASSIFIED_AFTER = 32
"""Steps, 80 ms, after a tap's onset in which no other rise of its kind follows."""

LIKE_IT = 0.2
"""Share of the sharpness from which another rise is of the same train: a finger's
bounces are softer."""

LIKE_IT_DB = 10.0
"""How far under the peak, in dB, another rise of the same train reaches at least."""

REST_FROM = 52
"""Steps, 0.13 s, before an onset from which the excess must be steady: a finger hardly
lifts and lands again sooner, and a sliding one is not so quiet where it turns. On
twelve surfaces a sliding steel stylus brings 1 tap in 10 min, without this 282."""

REST_TO = 8
"""Steps, 20 ms, before an onset up to which the excess must be steady: within these a
codec smears the impact ahead."""

STEADY_DB = 0.8
"""Deviation in dB of an excess that is steady: simulated noise has 0.24 to 0.74."""

STEADY = 0.035
"""Share of a tap's peak up to which the excess may deviate too: it leaves room for an
echo."""

REST_DB = 4.0
"""Mean excess that steady noise stays under in nine steps of ten, simulated and in a
real room: all shares of a peak are taken over it."""

LEAST_PEAK_DB = 10.0
"""Least peak of a tap in dB: simulated ones have 13.7 and more, real ones 26, creeping
up to 9.7."""

SHARP = 0.83
"""Least share of a tap's peak that rises within its attack."""

IMPACT_DB = 10.0
"""Rise in dB that is sharp whatever its share: a codec spreads an impact over the 20 ms
before it, so of a loud tap less than `SHARP` is one rise, in real ones 17 dB or
more."""

ATTACK = 2
"""Steps of a tap's attack, 5 ms."""

LATEST_PEAK = 4
"""Most steps to a tap's peak: a soft fingertip's comes within 10 ms."""

RINGING = 0.6
"""Greatest share of a tap's peak that is left when it has decayed: a slip that begins
at once goes on. In a room 0.5 is left of a real tap."""

DECAYED = 3
"""The last steps of `DECAYED_AFTER` over which that is measured."""

CLICK_STEPS = 2
"""A rise is reported as contact in its first or second step, if it is that of a tap so
far: its peak is yet to come."""

SLIDING = 16
"""Steps, 40 ms, over which the median excess of the bands tells sliding."""

SLIDING_ON_DB = 1.6
"""Median excess in dB from which sliding begins."""

SLIDING_OFF_DB = 0.8
"""Median excess in dB under which sliding ends."""

_HOLD_STEPS = round(SLIDE_HOLD * STEPS_PER_SECOND)

QUIET_RATE = 0.01
"""Share by which the background follows a step's level at rest: within 0.25 s."""

SLIDING_RATE = 2e-4
"""Share by which it follows while sliding: within 12 s."""

Floats = NDArray[np.float64]


class EventDetector:
    """Detects touch events in a stream; bit-equal at any block size.

    - ``sample_rate``: of the sound to come, in Hz; 2 kHz or more.
    - ``channels``: with two, channel 1 is air and knocks in the air are rejected.
    - ``tip``: what touches, one of `tactophone.core.tips.TIP_NAMES`.

    >>> sound = np.random.default_rng(0).normal(0, 1e-3, (48_000, 1)).astype(np.float32)
    >>> sound[24_000:24_240] *= 200
    >>> detector = EventDetector(sample_rate=48_000, channels=1)
    >>> [event.kind for event in detector.push(AudioBlock(sound, 48_000))]
    ['contact', 'tap']
    """

    def __init__(
        self, *, sample_rate: int, channels: int, tip: str = DEFAULT_TIP
    ) -> None:
        self._rate = sample_rate
        self._channels = channels
        self._air_led = TIPS[tip].air_led_db
        self._step = max(1, sample_rate // STEPS_PER_SECOND)
        self._window = np.hanning(2 * self._step + 2)[1:-1][:, None]
        self._edges = _band_edges(2 * self._step, sample_rate)
        self._band_count = len(self._edges) - 1
        self.reset()

    def reset(self) -> None:
        self._rest: FloatArray = np.zeros((self._step, self._channels), np.float32)
        self._count = 0
        self._origin = 0
        self._next = 0
        self._background: Floats = np.zeros((self._band_count, self._channels))
        self._first_levels: list[Floats] = []
        self._floor: Floats = np.zeros((self._band_count, self._channels))
        # Of each step: excess of its bands in contact, and the mean over the bands of
        # each channel.
        self._bands: deque[Floats] = deque(maxlen=2)
        self._means: deque[float] = deque(maxlen=EVENT_HISTORY)
        self._fluxes: deque[float] = deque(maxlen=EVENT_HISTORY)
        self._excess: deque[float] = deque([0.0] * SLIDING, SLIDING)
        # Of the newest rise, and of the newest that came out of rest.
        self._onset = self._landed = -CLASSIFIED_AFTER - 1
        self._since: list[Floats] = []
        self._unrest = self._sharpest = 0.0
        self._sliding = False
        self._touched_down = False
        self._still = 0

    def push(self, block: AudioBlock) -> list[TouchEvent]:
        """Take sound; return the events that it completes, oldest first, at seconds
        since the stream began."""
        return [event for _, event in self.push_timed(block)]

    def push_timed(self, block: AudioBlock) -> list[tuple[float, TouchEvent]]:
        """Do as :meth:`push`, and return with each event the moment in s at which it
        became known."""
        if block.start != self._next:
            # Sound was lost: what was before is no background of what comes.
            self.reset()
            self._origin = block.start
        self._next = block.end
        sound = np.concatenate((self._rest, block.samples[:, : self._channels]))
        steps = len(sound) // self._step - 1
        events: list[tuple[float, TouchEvent]] = []
        for begin in range(0, steps * self._step, self._step):
            level = self._levels(sound[begin : begin + 2 * self._step])
            if not self._count:
                self._background = level
            found = [*self._find_onset(level), *self._follow_sliding(level)]
            self._count += 1
            events += [(self._time(self._count), event) for event in found]
        self._rest = sound[steps * self._step :]
        return events

    def _levels(self, sound: FloatArray) -> Floats:
        """Return the level of each band and channel over a window, of which the last
        half is new."""
        spectrum = np.square(np.abs(np.fft.rfft(sound * self._window, axis=0)))
        bands = np.add.reduceat(spectrum, self._edges, axis=0)[
            : self._band_count
        ] / np.square(len(sound))
        return np.asarray(10 * np.log10(bands + EVENT_POWER_FLOOR))

    def _find_onset(self, level: Floats) -> list[TouchEvent]:
        if self._count < EVENT_SETTLED:
            self._first_levels.append(level)
            if len(self._first_levels) == EVENT_SETTLED:
                self._floor = np.quantile(self._first_levels, 0.25, axis=0)
            return []
        self._floor += np.where(level > self._floor, RISE, -FALL) / STEPS_PER_SECOND
        excess = 10 * np.log10(1 + 10 ** ((level - self._floor - FLOOR_BIAS_DB) / 10))
        flux = self._flux(excess[:, CONTACT])
        mean = excess.mean(axis=0)
        since = self._count - self._onset
        events = self._classify(mean, flux, since) if since <= CLASSIFIED_AFTER else []
        settled = since > CLASSIFIED_AFTER and len(self._fluxes) >= SLIDING
        # The median of the fluxes is never under 0, so most steps need no threshold.
        if settled and flux > LEAST_FLUX_DB and flux > self._threshold():
            self._begin_onset(mean, flux)
        elif (
            ATTACK < since <= CLASSIFIED_AFTER
            and self._sharpest < flux
            and _is_sharp(flux, mean[CONTACT] - REST_DB)
        ):
            # A sharper rise soon after an onset: what a codec smears before an impact,
            # or a light touch before the landing, began too early.
            self._begin_onset(mean, flux)
        rising = self._count - self._onset < CLICK_STEPS and self._landed != self._onset
        if rising and mean[CONTACT] > LEAST_PEAK_DB and self._is_rise(mean[CONTACT]):
            self._landed = self._onset
            events.append(TouchEvent("contact", self._time(self._onset)))
        self._bands.append(excess[:, CONTACT])
        self._means.append(float(mean[CONTACT]))
        self._fluxes.append(flux)
        return events

    def _begin_onset(self, mean: Floats, flux: float) -> None:
        self._onset = self._count
        self._since = [mean]
        self._sharpest = flux
        before = list(self._means)[-REST_FROM:-REST_TO]
        self._unrest = float(np.std(before)) if before else 0.0

    def _classify(self, mean: Floats, flux: float, since: int) -> list[TouchEvent]:
        self._since.append(mean)
        if since <= ATTACK:
            self._sharpest = max(self._sharpest, flux)
        if since < CLASSIFIED_AFTER:
            return []
        means, later = np.split(np.array(self._since), [DECAYED_AFTER + 1])
        peak = means.max(axis=0)
        decayed = np.median(means[-DECAYED:, CONTACT])
        early = int(means[:, CONTACT].argmax()) <= LATEST_PEAK
        rings = decayed - REST_DB > RINGING * (peak[CONTACT] - REST_DB)
        if (
            not early
            or rings
            or peak[CONTACT] < LEAST_PEAK_DB
            or not self._is_rise(peak[CONTACT])
        ):
            return []
        fluxes = np.array([*self._fluxes, flux])[-len(later) :]
        # Another rise of the same train.
        if np.any(
            (fluxes > LIKE_IT * self._sharpest)
            & (later[:, CONTACT] > peak[CONTACT] - LIKE_IT_DB)
        ):
            return []
        if self._channels > AIR and peak[AIR] - peak[CONTACT] > self._air_led:
            return [TouchEvent("knock", self._time(self._onset))]
        self._touched_down = True
        self._landed = self._onset
        # What rings after a tap is not sliding.
        self._excess.extend([0.0] * SLIDING)
        return [TouchEvent("tap", self._time(self._onset))]

    def _is_rise(self, peak: float) -> bool:
        """Return whether a sharp rise out of rest made a peak, in shares of its height
        over steady noise."""
        height = peak - REST_DB
        return self._unrest < max(STEADY_DB, STEADY * height) and _is_sharp(
            self._sharpest, height
        )

    def _flux(self, excess: Floats) -> float:
        """Return the mean rise of the bands, in dB, over the loudest of three
        neighbours two steps before."""
        if len(self._bands) < 2:
            return 0.0
        before = self._bands[-2]
        above = np.append(before[1:], before[-1])
        below = np.insert(before[:-1], 0, before[0])
        loudest = np.maximum(before, np.maximum(above, below))
        return float(np.maximum(excess - loudest, 0.0).mean())

    def _threshold(self) -> float:
        fluxes = np.array(self._fluxes)
        median = np.median(fluxes)
        return float(
            median + max(LEAST_FLUX_DB, DEVIATIONS * np.abs(fluxes - median).mean())
        )

    def _follow_sliding(self, level: Floats) -> list[TouchEvent]:
        # By how much the bands exceed their background, in dB, on average.
        self._excess.append(float((level - self._background)[:, CONTACT].mean()))
        median = float(np.median(self._excess))
        # The sound of a tap is no background.
        if self._count - self._landed > CLASSIFIED_AFTER:
            steady_rate = SLIDING_RATE if self._sliding else QUIET_RATE
            # At the beginning it is the mean of all steps so far.
            rate = max(1 / (self._count + 1), steady_rate)
            self._background = self._background + rate * (level - self._background)
        began = self._time(max(0, self._count - SLIDING // 2))
        settled = self._count - self._landed > CLASSIFIED_AFTER
        if (
            not self._sliding
            and settled
            and median >= SLIDING_ON_DB
            and self._count > EVENT_HISTORY // 2
        ):
            self._sliding = True
            self._still = 0
            kind = "stroke" if self._touched_down else "slip"
            self._touched_down = False
            return [TouchEvent(kind, began)]
        self._still = self._still + 1 if median < SLIDING_OFF_DB else 0
        if self._sliding and self._still > _HOLD_STEPS:
            self._sliding = False
            still_for = _HOLD_STEPS * self._step / self._rate
            return [TouchEvent("lift-off", began - still_for)]
        return []

    def _time(self, step: int) -> float:
        return (self._origin + step * self._step) / self._rate


def _is_sharp(rise: float, height: float) -> bool:
    return rise > min(SHARP * height, IMPACT_DB)


def _band_edges(size: int, rate: int) -> NDArray[np.intp]:
    """Return the first bin of each band, and of what lies over them; fewer bands at low
    rates."""
    highest = min(HIGHEST, 0.45 * rate)
    edges = np.round(np.geomspace(LOWEST, highest, BANDS + 1) * size / rate).astype(
        np.intp
    )
    # At least a bin for each band: low ones are narrower than a bin.
    for band in range(1, len(edges)):
        edges[band] = max(edges[band], edges[band - 1] + 1)
    return np.unique(np.minimum(edges, size // 2))


class EventMerger:
    """Adds a prediction for each touch event: the newest one, moved up to the event,
    which it carries.

    A prediction that a window brings comes every 10 ms; an event must be rendered
    within 5 ms. Bit-equal at any block size, as events and predictions are ordered by
    when they became known.
    """

    def __init__(self, detector: EventDetector) -> None:
        self._detector = detector
        self.reset()

    def reset(self) -> None:
        self._detector.reset()
        self._newest = Prediction(
            (1.0, 0.0, 0.0), Touch.NONE, 0.0, float("-inf"), start=0.0, end=0.0
        )

    def merge(
        self, block: AudioBlock, predictions: list[Prediction], *, latency: float
    ) -> Iterator[Prediction]:
        """Yield a block's predictions, known ``latency`` s after their end, with those
        of its events."""
        waiting = list(predictions)
        for known, event in self._detector.push_timed(block):
            end = known - latency
            while waiting and waiting[0].end <= end:
                self._newest = waiting.pop(0)
                yield self._newest
            start = self._newest.start + end - self._newest.end
            yield replace(self._newest, start=start, end=end, events=(event,))
        for prediction in waiting:
            self._newest = prediction
            yield prediction
