"""The contact gate: detects the start and end of a touch within milliseconds, where a
window of 256 ms cannot.

A window still contains a touch 240 ms after the finger has lifted, and is only a
twentieth full when the finger has just landed. So the gate measures the level four
thousand times a second, beside the classifier. A clearly loud touch opens it by the
level over 4 ms; any other by the level over 32 ms, because motor noise and hum
sometimes rise 5 dB for 4 ms, but not for 32. The gate closes when the longer level has
fallen under the threshold.

A level cannot tell motors from touch: a moving robot raises it by 3 dB, and the gate
opens 2 dB over the floor. So sixteen bands decide, each over its own floor: motors
raise few of them, and little; a touch raises many. Their windows are longer, so the
level gate alone counts for the first 50 ms after it opens.

Where a model hears both microphones, what may have come through the air is taken off
(`signal.perception.airborne`): a band counts only where it is louder than that, and a
level that opens while the air microphone is far louder is not trusted. Until the noise
is known, that level alone decides, and it is compared with the air at every hop.

A robot that says when it starts and stops (`core.types.AudioBlock.moving`) is not felt
then: around both, contact has to last before it counts.

The threshold follows the noise floor (`signal.perception.noise_floor`) unless it was
given or calibrated; then the level decides alone. A touch is held over a silence as
short as that of a finger that has just landed, or of a stroke that turns.

What the gate measures becomes events of the machines in
`signal.perception.contact_state`, whose tables decide.

The paper has no such gate (it compares the level of the whole window): `feel --contact
window` turns it off.
"""

import math
from dataclasses import dataclass, field

import numpy as np

from tactophone.core.microphones import AIR, CONTACT
from tactophone.core.types import AudioBlock, ContactThreshold, FloatArray
from tactophone.signal.perception.airborne import (
    NOTHING,
    AirborneSound,
    mean_excess_db,
)
from tactophone.signal.perception.contact_state import (
    Durations,
    Level,
    LevelMachine,
    Persistence,
    PersistenceMachine,
    Thresholds,
    Trust,
    TrustMachine,
    contact_of,
)
from tactophone.signal.perception.levels import (
    BANDS_HOP,
    BANDS_WINDOW,
    FAST,
    SLOW,
    LevelMeter,
    LoudnessRule,
)
from tactophone.signal.perception.noise_floor import (
    BAND_MARGIN_DB,
    HIGHEST_DBFS,
    Floats,
    NoiseFloor,
    RecordingFloor,
)

CLEAR_DB = 5.0
"""Margin over the threshold at which the fast level opens the gate by itself."""

RELEASE_DB = 0.5
"""Margin under a fixed threshold at which the slow level closes the gate. One measured
in silence is 1.9 dB over noise that varies by 0.3 dB (`margin_db`): at 3 dB, that noise
itself would keep a touch open."""

SHORTEST_GATED_TOUCH = 0.03
"""Shortest touch in s: a shorter one is not perceived as vibration (Sci. Rep. 2025,
15:5057)."""

BANDS_ON_DB = 1.15
"""Mean over the bands of what exceeds floor and margin, in dB, that begins contact."""

BANDS_OFF_DB = 0.3
"""The same mean, in dB, under which contact ends."""

EARLY = 0.05
"""Seconds from the opening of the level gate in which it is trusted alone: the bands'
windows are 64 ms long."""

LONGEST_WAIT = 0.011
"""Longest time in s that sound waits while the level says what it said before: a window
of the shipped models. A change that the bands alone tell, whose windows are six times
as long, comes with the model's window."""

LOOK_EVERY = 0.04
"""Seconds from one look at the air microphone to the next, in silence and while a touch
goes on: a spectrum of it costs as much as one of the contact microphone. What is loud,
but no touch, is compared with it at every hop of the bands."""

DISTRUST = 1.0
"""Seconds after an opening that no band confirmed in which another counts for nothing:
motors open the level gate."""

JERK = 0.5
"""Seconds from a start or stop of the robot in which new contact counts only once it
has persisted."""

PERSISTENT = 0.15
"""Seconds that such contact has to last before it counts."""


@dataclass(frozen=True, slots=True)
class Contact:
    """State of the contact gate from a moment on.

    - ``time``: seconds since the stream began.
    - ``touching``: whether there is contact.
    - ``held``: whether that is only held over a silence.
    - ``threshold_dbfs``: level from which there was contact at that time.
    """

    time: float
    touching: bool
    held: bool = field(default=False, repr=False)
    threshold_dbfs: float = field(default=-math.inf, repr=False, compare=False)


class ContactGate:
    """Detects contact from the level of the contact microphone.

    - ``threshold_dbfs``: level from which there is contact.
    - ``rule``: how the level is measured: ``rms``, ``mean_absolute``, or ``banded``:
      without hum and motors.
    - ``sample_rate``: of the sound to come, in Hz.
    - ``floor``: where there is one, the threshold begins at its own and follows it,
      until another threshold is assigned.
    - ``bands``: let the bands decide, each over its own floor, once the floor is known;
      not by a threshold that was assigned.
    - ``pair``: whether a second channel of the sound is an air microphone, so that
      what may have come through the air is no touch. Only bands can tell.
    - ``hold``: seconds that contact lasts on over silence.
    - ``threshold``: a shared one may take its place.
    - ``microphone``: the channel that it hears, where there are two.
    - ``longest_wait``: samples that may wait while `stays_ahead`.

    >>> import numpy as np
    >>> gate = ContactGate(-40, sample_rate=48_000)
    >>> sound = np.zeros((4800, 1), np.float32)
    >>> sound[480:960] = 0.1
    >>> changes = gate.push(AudioBlock(sound, 48_000))
    >>> [change for change in changes if change.touching][0]
    Contact(time=0.01025, touching=True)
    """

    def __init__(
        self,
        threshold_dbfs: float,
        *,
        sample_rate: int,
        rule: LoudnessRule = "rms",
        floor: NoiseFloor | None = None,
        bands: bool = False,
        pair: bool = False,
        hold: float = 0.0,
    ) -> None:
        self.microphone = CONTACT
        self.longest_wait = round(LONGEST_WAIT * sample_rate)
        self.levels = LevelMeter(rule, sample_rate=sample_rate, bands=bands)
        self.floor = floor
        self.threshold = ContactThreshold(
            threshold_dbfs, follows_floor=floor is not None
        )
        self.air = AirborneSound(rule, sample_rate=sample_rate) if pair else None
        self._sample_rate = sample_rate
        self._has_bands = bands
        # Of a hand, the finger whose levels these are, and whether others push sound.
        self._finger = 0
        self._shared = False
        count = self.levels.steps.count
        self._step_size = self.levels.steps.step_size
        self._hop = count(BANDS_HOP)
        self._look_hops = round(LOOK_EVERY / BANDS_HOP)
        self._durations = Durations(
            shortest=count(SHORTEST_GATED_TOUCH),
            hold=count(hold),
            early=count(EARLY),
            distrust=count(DISTRUST),
            jerk=count(JERK),
            persistent=count(PERSISTENT),
        )
        self.reset()

    def _compare_with(self, level_dbfs: float, release_dbfs: float) -> None:
        """Compare with these levels from now on."""
        power = self.levels.steps.power
        self._threshold_dbfs = level_dbfs
        self._thresholds = Thresholds(
            open_from=10 ** (power * level_dbfs / 20),
            clear_from=10 ** (power * (level_dbfs + CLEAR_DB) / 20),
            close_under=10 ** (power * release_dbfs / 20),
        )
        self._following = self.threshold.follows_floor

    def reset(self) -> None:
        """Return to the initial state: no contact; the floor is measured anew."""
        if not self._shared:
            self.levels.reset()
        # Steps taken so far, and samples of the next one.
        self._steps = 0
        self._part = 0
        self._level = LevelMachine(self._durations)
        self._trust = TrustMachine(self._durations)
        self._persistence = PersistenceMachine(self._durations)
        # Whether the bands are loud now, and for how many steps they have not been.
        self._bands_loud = False
        self._bands_silent_for = self._durations.hold + 1
        # What may have come through the air, in each band, when that was last looked
        # at; and whether the bands are loud only with it.
        self._by_air = NOTHING
        self._is_airborne = False
        self._moving = False
        # The sample up to which the windows of the levels hold concealment.
        self._invented_until = 0
        # What was last told: whether there is contact, and whether it is only held.
        self._reported = (False, False)
        if self.floor:
            self.floor.reset()
        if self.air:
            self.air.reset()
        self._compare_with(self.threshold.dbfs, self.threshold.dbfs - RELEASE_DB)
        if self.floor and self.threshold.follows_floor:
            self._follow(self.floor)

    def begin(self, recording: RecordingFloor) -> None:
        """Begin at the floor of a recording; where it has none or the level decides,
        with its threshold."""
        if self.floor and self._has_bands and recording.known:
            self.floor.begin(recording)
            self._follow(self.floor)
        else:
            self.threshold.dbfs = recording.threshold_dbfs

    def push(self, block: AudioBlock) -> list[Contact]:
        """Take sound; return each change of contact, and a heartbeat every second
        hop."""
        if not self._compares_with_threshold:
            # Another was assigned.
            self._compare_with(self.threshold.dbfs, self.threshold.dbfs - RELEASE_DB)
        if block.moving is not self._moving:
            self._moving = block.moving
            self._persistence.jerk(self._steps, starts=block.moving)
        if not self._shared:
            self.levels.push(self.own_channel(block))
        if self.air:
            self.air.hear(_air_channel(block))
        if block.concealed:
            end = self._steps * self._step_size + self._part + block.size
            self._invented_until = end + round(BANDS_WINDOW * self._sample_rate)
        self._part += block.size
        steps, self._part = divmod(self._part, self._step_size)
        return self._take(steps)

    def own_channel(self, block: AudioBlock) -> FloatArray:
        """Return the channel that the gate hears, ``(1, samples)``."""
        return block.samples.T[self.channel_of(block.channels) :][:1]

    def channel_of(self, channels: int) -> int:
        """Return which of so many channels it hears: its microphone's, or the only
        one."""
        return min(self.microphone, channels - 1)

    def share(self, levels: LevelMeter, finger: int) -> None:
        """Take the levels of one finger from a meter that measures all fingers, and to
        which others push sound."""
        self.levels = levels
        self._finger = finger
        self._shared = True
        self.reset()

    @property
    def is_shared(self) -> bool:
        """Whether its levels are measured together with those of other fingers."""
        return self._shared

    @property
    def stays_ahead(self) -> bool:
        """Whether the level says of the sound that it looked ahead at what it said
        before; then that sound may wait for up to `longest_wait`."""
        is_early = (
            self._level.state is not Level.CLOSED
            and self._level.open_for < self._durations.early
        )
        if is_early:
            return False  # the bands are about to confirm it, or to end it
        slow = self.levels.slow[self._finger]
        fast = self.levels.fast[self._finger]
        return self._compares_with_threshold and self._level.stays(
            slow, fast, self._thresholds
        )

    @property
    def _compares_with_threshold(self) -> bool:
        """Whether nobody has assigned another threshold since it was last compared
        with."""
        threshold = self.threshold
        return (
            threshold.dbfs == self._threshold_dbfs
            and threshold.follows_floor is self._following
        )

    def _take(self, steps: int) -> list[Contact]:
        """Evaluate steps one after another, and a row of the bands at each hop; return
        what changed."""
        measured_slow = self.levels.slow[self._finger]
        measured_fast = self.levels.fast[self._finger]
        rows = self.levels.bands[self._finger]
        slow = measured_slow[:steps]
        fast = measured_fast[:steps]
        del measured_slow[:steps], measured_fast[:steps]
        contacts: list[Contact] = []
        start = 0
        while start < steps:
            # Up to the end of the hop of the bands, or of what was measured.
            end = min(steps, start + self._hop - self._steps % self._hop)
            if self._level.stays(slow[start:end], fast[start:end], self._thresholds):
                self._level.pass_over(end - start)
                self._steps += end - start
            else:
                for each in range(start, end):
                    contacts += self._step(slow[each], fast[each])
            if self._steps % self._hop == 0:
                bands = rows.pop(0) if rows else _NO_BANDS
                contacts += self._end_hop(slow[end - 1], bands)
            start = end
        return contacts

    def _step(self, slow: float, fast: float) -> list[Contact]:
        self._steps += 1
        if self._level.step(slow, fast, self._thresholds):
            by_air = self.air is not None and self._is_airborne_at(self.air, slow, fast)
            self._trust.open(self._steps, by_air=by_air)
        return self._report()

    def _is_airborne_at(self, air: AirborneSound, slow: float, fast: float) -> bool:
        """Whether the levels of the step that opens the gate may have come through the
        air."""
        if slow >= self._thresholds.open_from:
            return air.explains(self._dbfs(slow), at=self._samples, seconds=SLOW)
        return air.explains(self._dbfs(fast), at=self._samples, seconds=FAST)

    @property
    def _samples(self) -> int:
        """Samples of the steps so far."""
        return self._steps * self._step_size

    def _dbfs(self, power: float) -> float:
        """Return the level of a power of the steps; NaN for silence."""
        if power <= 0:
            return math.nan
        return 20 / self.levels.steps.power * math.log10(power)

    def _end_hop(self, slow: float, bands: Floats) -> list[Contact]:
        """Ask the bands, and let the floor follow."""
        if self._by_bands and self.floor:
            self._ask_bands(self.floor, bands)
        elif self.air and self._awaits_floor:
            self._ask_air(self.air, slow, bands)
        touching, _ = self._decide()
        # Concealment fades, and what is quieter than silence would teach a floor under
        # which the room's own noise is contact.
        invented = self._steps * self._step_size <= self._invented_until
        if self.floor and self._following and not invented:
            # Until the windows are full of sound, part of the levels is that of their
            # zeros.
            full = self._samples >= BANDS_WINDOW * self._sample_rate
            # A sound from the air is no more the microphone's noise than a touch is.
            # Until the noise is known, neither is whatever opens the level.
            is_open = self._level.state is not Level.CLOSED
            unsettled = self._awaits_floor and is_open
            sounding = touching or self._is_airborne or unsettled
            self.floor.push(
                self._dbfs(slow) if full else math.nan,
                bands,
                touching=sounding,
                loud=is_open,
            )
            if self.air and full:
                self._follow_air(self.air, sounding=sounding)
            if self.floor.threshold_dbfs != self._threshold_dbfs:
                self._follow(self.floor)
        return self._report(due=self._is_due(2))

    def _follow_air(self, air: AirborneSound, *, sounding: bool) -> None:
        """Let the floor of the air microphone follow, at every hop until it is
        known."""
        hops = self._look_hops if air.floor.known else 1
        if self._is_due(hops):
            air.follow(self._samples, sounding=sounding, hops=hops)

    def _is_due(self, hops: int) -> bool:
        """Whether this is one of every so many hops."""
        return self._steps % (hops * self._hop) == 0

    def _ask_bands(self, floor: NoiseFloor, bands: Floats) -> None:
        loud_from = BANDS_OFF_DB if self._bands_loud else BANDS_ON_DB
        heard_from = floor.bands + floor.margin_db
        is_loud = mean_excess_db(bands, heard_from) >= loud_from
        self._is_airborne = (
            is_loud
            and self.air is not None
            and not self._exceed_air(bands, self.air, floor, loud_from)
        )
        self._bands_loud = is_loud and not self._is_airborne
        self._bands_silent_for = (
            0 if self._bands_loud else self._bands_silent_for + self._hop
        )
        self._trust.check(self._level, self._steps, confirmed=self._bands_recent)

    def _ask_air(self, air: AirborneSound, slow: float, bands: Floats) -> None:
        """While the level alone decides, trust it where what may not have come through
        the air is as loud as contact too."""
        if slow < self._thresholds.open_from:
            return
        left = air.share_left(
            bands, self._samples, margin_db=BAND_MARGIN_DB, loud_from=BANDS_ON_DB
        )
        trusted = self._trust.state is not Trust.DISTRUSTED
        heard_from = (
            self._thresholds.close_under if trusted else self._thresholds.open_from
        )
        by_air = slow * left < heard_from
        self._trust.compare_with_air(by_air=by_air, steps=self._hop)

    def _exceed_air(
        self, bands: Floats, air: AirborneSound, floor: NoiseFloor, loud_from: float
    ) -> bool:
        """Whether the bands are loud over what may have come through the air too."""
        # A look of a moment ago may let a touch go on, but not end it.
        goes_on = self._bands_loud and not self._is_due(self._look_hops)
        if goes_on and self._excess_db(bands, floor) >= loud_from:
            return True
        self._by_air = air.in_contact(
            self._samples, margin_db=floor.margin_db, loud_from=loud_from
        )
        return self._excess_db(bands, floor) >= loud_from

    def _excess_db(self, bands: Floats, floor: NoiseFloor) -> float:
        noise = np.maximum(floor.bands, self._by_air)
        return mean_excess_db(bands, noise + floor.margin_db)

    @property
    def _bands_recent(self) -> bool:
        return self._bands_silent_for <= self._durations.hold

    @property
    def _by_bands(self) -> bool:
        # Sound as loud as the highest threshold is touch, not noise, however steady it
        # is.
        known = (
            self.floor is not None
            and self.floor.known
            and self._threshold_dbfs < HIGHEST_DBFS
        )
        return known and self._has_bands and self._following

    @property
    def _awaits_floor(self) -> bool:
        """Whether the bands are to decide, but the noise is not known yet."""
        awaits = self.floor is not None and not self.floor.known
        return awaits and self._has_bands and self._following

    def _decide(self) -> tuple[bool, bool]:
        """Return whether there is contact, and whether it is only held."""
        return contact_of(
            self._level.state,
            self._trust.state,
            by_bands=self._by_bands,
            bands_loud=self._bands_loud,
            bands_recent=self._bands_recent,
            needs_trust=self.air is not None and self._awaits_floor,
        )

    def _report(self, *, due: bool = False) -> list[Contact]:
        """Return the state if it changed or a heartbeat is due."""
        touching, held = self._decide()
        # Whether it persists is told by the level: the bands lag by their windows.
        level_silent = self._level.state is not Level.OPEN
        self._persistence.update(self._steps, touching=touching, held=level_silent)
        if self._persistence.state is Persistence.PENDING:
            touching = False
            held = False
        if (touching, held) == self._reported and not due:
            return []
        self._reported = (touching, held)
        time = self._steps * self._step_size / self._sample_rate
        return [Contact(time, touching, held, self._threshold_dbfs)]

    def _follow(self, floor: NoiseFloor) -> None:
        self.threshold.follow(floor.threshold_dbfs)
        self._compare_with(floor.threshold_dbfs, floor.release_dbfs)


def _air_channel(block: AudioBlock) -> FloatArray:
    """Return the air microphone's samples, or silence where the sound has none."""
    if block.channels > 1:
        return block.samples[:, AIR]
    return np.zeros(block.size, np.float32)


_NO_BANDS = np.zeros(0)
