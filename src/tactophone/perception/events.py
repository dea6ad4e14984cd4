"""Touch events by sound: taps, strokes that begin and end, slip; a knock in the air is no touch.

Contact microphones separate a finger's taps by their onset (VSkin, Sun et al., CHI 2018; Acustico, Gong et al., UIST
2020). Here an onset is a rise in 24 logarithmic bands over the loudest neighbour two steps before (SuperFlux, Böck &
Widmer, DAFx 2013), against a threshold of median and deviation over the last half second: it looks at no later sound.
An onset is reported at once as *contact*, and as a *tap* when the next 25 ms are over and it was no knock in the air.

Sliding is an excess of all bands over the background for 30 ms. It begins a *stroke*, or a *slip* if no touch-down was
detected since the last sliding ended; its end is a *lift-off*. A finger that rests sounds like one
that has left: lift-off means that the sliding ended.
"""

import math
from collections import deque

import numpy as np
from numpy.typing import NDArray

from tactophone.types import AIR, CONTACT, AudioBlock, FloatArray, TouchEvent

STEPS_PER_SECOND = 400
"""A step of 2.5 ms: an onset must be reported within 5 ms of the contact."""

BANDS, LOWEST, HIGHEST = 24, 200.0, 12_000.0
"""Logarithmic bands, in Hz; a window of two steps resolves 200 Hz."""

FLOOR = 1e-10
"""Power a band counts at least as, -100 dB: digital silence has no finite level."""

HISTORY = 200
"""Steps, half a second, of the adaptive threshold."""

DEVIATIONS, LEAST_FLUX_DB = 6.0, 4.0
"""An onset's flux exceeds the median by so many mean absolute deviations, and by so much."""

REFRACTORY = 24
"""Steps, 60 ms, until the next onset: a tap rings and bounces for so long."""

CLASSIFIED_AFTER = 10
"""Steps, 25 ms, of sound that the class of an onset is taken from."""

AIR_LED_DB = 27.0
"""A knock in the air exceeds the background in the air microphone by so much more than in the contact microphone; a
touch-down by less (10 to 21 dB, knocks 33 to 36 in simulated sound of eight objects). In dB."""

LATE, DECAY_DB, LATE_SHARE, LONG_DECAY_DB = 6, 7.0, 0.4, 18.0
"""A tap is over soon: from so many steps after the onset (15 ms) its mean excess is so much under its peak, and at most
this share of it, or by the last figure under it (a loud tap rings on in a room). What goes on is sliding."""

SLIDING, SLIDING_ON_DB, SLIDING_OFF_DB = 16, 1.6, 0.8
"""Steps, 40 ms, over which the median excess of the bands begins sliding, and ends it."""

AFTER_SLIDING = 40
"""Steps, 0.1 s, from the end of sliding until an onset counts: the last bursts of a stroke are no taps."""

QUIET_RATE, SLIDING_RATE = 0.01, 2e-4
"""Share by which the background follows a step's level: within 0.25 s at rest, 12 s while sliding."""

Floats = NDArray[np.float64]


class EventDetector:
    """Detects touch events in a stream; bit-equal at any block size.

    Parameters
    ----------
    sample_rate
        Of the sound to come, in Hz; 4 kHz or more.
    channels
        With two, channel 1 is air and knocks in the air are rejected.
    threshold_dbfs
        RMS of the contact channel from which there is contact: while it has been for 32 ms, there are no taps.

    Examples
    --------
    >>> sound = np.random.default_rng(0).normal(0, 1e-3, (48_000, 1)).astype(np.float32)
    >>> sound[24_000:24_240] *= 200
    >>> [event.kind for event in EventDetector(sample_rate=48_000, channels=1).push(AudioBlock(sound, 48_000))]
    ['contact', 'tap']
    """

    def __init__(self, *, sample_rate: int, channels: int, threshold_dbfs: float = math.inf) -> None:
        self._rate, self._channels = sample_rate, channels
        self.threshold_dbfs = threshold_dbfs
        self._step = max(1, sample_rate // STEPS_PER_SECOND)
        self._window = np.hanning(2 * self._step + 2)[1:-1][:, None]
        self._edges = _band_edges(2 * self._step, sample_rate)
        self.reset()

    @property
    def latency(self) -> float:
        """Longest time in s from an onset to its report: a step that it begins in, and the next."""
        return 2 * self._step / self._rate

    def reset(self) -> None:
        """Return to the initial state."""
        self._rest: FloatArray = np.zeros((self._step, self._channels), np.float32)
        self._count, self._origin, self._next = 0, 0, 0
        self._background: Floats | None = None
        self._levels: deque[Floats] = deque(maxlen=3)
        self._fluxes: deque[float] = deque(maxlen=HISTORY)
        self._powers: deque[float] = deque(maxlen=13)
        self._excess: deque[float] = deque([0.0] * SLIDING, SLIDING)
        self._onset = -REFRACTORY
        self._peak, self._late = np.zeros(self._channels), 0.0
        self._sliding, self._touched_down, self._slid = False, False, -AFTER_SLIDING

    def push(self, block: AudioBlock) -> list[TouchEvent]:
        """Take sound; return the events that it completes, oldest first, at seconds since the stream began."""
        return [event for _, event in self.push_timed(block)]

    def push_timed(self, block: AudioBlock) -> list[tuple[float, TouchEvent]]:
        """Do as :meth:`push`, and return with each event the moment in s at which it became known."""
        if block.start != self._next:
            # Sound was lost: what was before is no background of what comes.
            self.reset()
            self._origin = block.start
        self._next = block.end
        samples = np.nan_to_num(block.samples[:, : self._channels], nan=0.0, posinf=0.0, neginf=0.0)
        sound = np.concatenate((self._rest, samples))
        steps = len(sound) // self._step - 1
        events: list[tuple[float, TouchEvent]] = []
        for number in range(steps):
            begin = number * self._step
            found = self._advance(sound[begin : begin + 2 * self._step])
            events += [(self._time(self._count), event) for event in found]
        self._rest = sound[steps * self._step :]
        return events

    def _advance(self, sound: FloatArray) -> list[TouchEvent]:
        """Take a window, of which the last half is new."""
        spectrum = np.square(np.abs(np.fft.rfft(sound * self._window, axis=0)))
        bands = np.add.reduceat(spectrum, self._edges, axis=0)[:BANDS] / np.square(len(sound))
        level = 10 * np.log10(bands + FLOOR)
        new = sound[self._step :, CONTACT]
        self._powers.append(float(np.vdot(new, new)) / self._step)
        if self._background is None:
            self._background = level.copy()
        events = [*self._find_onset(level), *self._follow_sliding(level)]
        self._levels.append(level)
        self._count += 1
        return events

    def _find_onset(self, level: Floats) -> list[TouchEvent]:
        since = self._count - self._onset
        events = self._classify(level, since) if since <= CLASSIFIED_AFTER else []
        flux = self._flux(level[:, CONTACT])
        resting = not self._sliding and self._count - self._slid >= AFTER_SLIDING
        # The newest steps are of the onset itself.
        before = list(self._powers)[:-3]
        resting = resting and (not before or sum(before) / len(before) < 10 ** (self.threshold_dbfs / 10))
        if resting and since >= REFRACTORY and len(self._fluxes) >= SLIDING and flux > self._threshold():
            self._onset = self._count
            self._peak, self._late = self._excess_of(level), 0.0
            events.append(TouchEvent("contact", self._time(self._count)))
        self._fluxes.append(flux)
        return events

    def _classify(self, level: Floats, since: int) -> list[TouchEvent]:
        excess = self._excess_of(level)
        self._peak = np.maximum(self._peak, excess)
        if since > LATE:
            self._late += float(excess[CONTACT]) / (CLASSIFIED_AFTER - LATE)
        if since < CLASSIFIED_AFTER:
            return []
        if self._channels > AIR and self._peak[AIR] - self._peak[CONTACT] > AIR_LED_DB:
            return [TouchEvent("knock", self._time(self._onset))]
        peak = float(self._peak[CONTACT])
        if peak - self._late < DECAY_DB or (self._late > LATE_SHARE * peak and peak - self._late < LONG_DECAY_DB):
            return []
        self._touched_down = True
        # What rings after a tap is not sliding.
        self._excess.extend([0.0] * SLIDING)
        return [TouchEvent("tap", self._time(self._onset))]

    def _flux(self, level: Floats) -> float:
        """Return the mean rise of the bands, in dB, over the loudest of three neighbours two steps before."""
        if len(self._levels) < 2:
            return 0.0
        before = self._levels[-2][:, CONTACT]
        above, below = np.append(before[1:], before[-1]), np.insert(before[:-1], 0, before[0])
        loudest = np.maximum(before, np.maximum(above, below))
        return float(np.maximum(level - loudest, 0.0).mean())

    def _threshold(self) -> float:
        fluxes = np.array(self._fluxes)
        median = np.median(fluxes)
        return float(median + max(LEAST_FLUX_DB, DEVIATIONS * np.abs(fluxes - median).mean()))

    def _excess_of(self, level: Floats) -> Floats:
        """Return by how much each channel exceeds its background, in dB, mean of the bands."""
        background = level if self._background is None else self._background
        return np.asarray((level - background).mean(axis=0))

    def _follow_sliding(self, level: Floats) -> list[TouchEvent]:
        excess = self._excess_of(level)[CONTACT]
        self._excess.append(float(excess))
        median = float(np.median(self._excess))
        # The sound of a tap is no background.
        if self._count - self._onset >= REFRACTORY or self._onset < 0:
            rate = max(1 / (self._count + 1), SLIDING_RATE if self._sliding else QUIET_RATE)
            background = level if self._background is None else self._background
            self._background = background + rate * (level - background)
        began = self._time(max(0, self._count - SLIDING // 2))
        settled = self._count - self._onset >= REFRACTORY
        if not self._sliding and settled and median >= SLIDING_ON_DB and self._count > HISTORY // 2:
            self._sliding = True
            kind = "stroke" if self._touched_down else "slip"
            self._touched_down = False
            return [TouchEvent(kind, began)]
        if self._sliding and median < SLIDING_OFF_DB:
            self._sliding, self._slid = False, self._count
            return [TouchEvent("lift-off", began)]
        return []

    def _time(self, step: int) -> float:
        return (self._origin + step * self._step) / self._rate


def _band_edges(size: int, rate: int) -> NDArray[np.intp]:
    """Return the first bin of each band, and of what lies over them."""
    highest = min(HIGHEST, 0.45 * rate)
    edges = np.round(np.geomspace(LOWEST, highest, BANDS + 1) * size / rate).astype(np.intp)
    # At least a bin for each band: low ones are narrower than a bin.
    for band in range(1, len(edges)):
        edges[band] = max(edges[band], edges[band - 1] + 1)
    return np.minimum(edges, size // 2)
