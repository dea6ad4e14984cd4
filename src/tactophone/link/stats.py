"""How the line does, in the vocabulary of RFC 3550 and of WebRTC's inbound statistics.

========================  ===================================================================================
here                      WebRTC (``RTCInboundRtpStreamStats``)
========================  ===================================================================================
``packets_received``      ``packetsReceived``, duplicates left out
``packets_lost``          ``packetsLost``: expected less received, before any mending
``most_lost``             none: the most that ``packets_lost`` was; a late packet lowers that, but not a counter
``packets_late``          ``packetsDiscarded``: came after their place had been filled
``packets_duplicated``    none; RFC 3550 counts them as received
``packets_reordered``     none: came after a younger one
``packets_recovered``     ``fecPacketsReceived`` that were of use
``packets_concealed``     none: lost packets whose sound was guessed
``packets_skipped``       none: came too late to be judged, kept as history
``jitter``                ``jitter``, RFC 3550 section 6.4.1
``samples_received``      ``totalSamplesReceived``
``samples_concealed``     ``concealedSamples``
``concealment_events``    ``concealmentEvents``
``samples_skipped``       none: holes too long to be worth guessing
========================  ===================================================================================
"""

from dataclasses import dataclass

from tactophone.link.packet import CLOCK_RATE, ahead
from tactophone.link.rtcp import ReceiverReport, SenderReport


@dataclass(slots=True)
class StreamStats:
    """Counters of one stream since it began; see the module for their meaning."""

    packets_received: int = 0
    packets_late: int = 0
    packets_duplicated: int = 0
    packets_reordered: int = 0
    packets_recovered: int = 0
    packets_concealed: int = 0
    packets_skipped: int = 0
    packets_broken: int = 0
    octets_received: int = 0
    samples_received: int = 0
    samples_concealed: int = 0
    samples_skipped: int = 0
    concealment_events: int = 0
    jitter: float = 0.0
    most_lost: int = 0
    first: int | None = None
    highest: int = 0

    @property
    def packets_expected(self) -> int:
        """From the first to the highest sequence number heard."""
        return 0 if self.first is None else self.highest - self.first + 1

    @property
    def packets_lost(self) -> int:
        """Expected and never received (RFC 3550 appendix A.3)."""
        return max(0, self.packets_expected - self.packets_received)


class Reception:
    """Keeps a stream's `StreamStats` and writes the reports of it."""

    def __init__(self) -> None:
        self.stats = StreamStats()
        self._transit: float | None = None
        self._seen: set[int] = set()
        self._reported = (0, 0)
        self._last_report = (0, 0.0)

    def count(self, sequence: int, timestamp: int, octets: int, *, now: float) -> bool:
        """Note a packet's arrival; false when it came before (only the newest 2**10 are remembered)."""
        stats, number = self.stats, self._extend(sequence)
        if number in self._seen:
            stats.packets_duplicated += 1
            return False
        self._remember(number)
        stats.packets_received += 1
        stats.packets_reordered += number < stats.highest
        stats.octets_received += octets
        stats.highest = max(stats.highest, number)
        stats.most_lost = max(stats.most_lost, stats.packets_lost)
        self._update_jitter(timestamp, now)
        return True

    def hear(self, report: SenderReport, *, now: float) -> None:
        """Note the peer's report, to return it with the time that it lay here."""
        self._last_report = (report.stamp, now)

    def report(self, *, ssrc: int, of: int, now: float) -> ReceiverReport:
        """Write what was heard since the last report."""
        stats = self.stats
        expected, received = stats.packets_expected - self._reported[0], stats.packets_received - self._reported[1]
        self._reported = (stats.packets_expected, stats.packets_received)
        fraction = max(0.0, 1 - received / expected) if expected > 0 else 0.0
        stamp, came = self._last_report
        since = now - came if stamp else 0.0
        return ReceiverReport(ssrc, of, fraction, stats.packets_lost, stats.highest, stats.jitter, stamp, since)

    def _extend(self, sequence: int) -> int:
        """Undo the wrapping of a sequence number (RFC 3550 appendix A.1)."""
        if self.stats.first is None:
            self.stats.first = self.stats.highest = sequence
        return self.stats.highest + ahead(sequence, self.stats.highest % (1 << 16), bits=16)

    def _remember(self, number: int) -> None:
        self._seen.add(number)
        if len(self._seen) > 1 << 11:
            self._seen = {seen for seen in self._seen if seen > self.stats.highest - (1 << 10)}

    def _update_jitter(self, timestamp: int, now: float) -> None:
        """Smooth the change of transit times by a sixteenth (RFC 3550 appendix A.8)."""
        transit = now - timestamp / CLOCK_RATE
        if self._transit is not None:
            # The timestamp wraps once a day; the one step that this makes is no jitter.
            change = (abs(transit - self._transit) + 0.5) % ((1 << 32) / CLOCK_RATE) - 0.5
            self.stats.jitter += (change - self.stats.jitter) / 16
        self._transit = transit
