"""The profile ``events``: a touch-down is felt as a short click, at once; sliding as the paper renders it."""

import math

from tactophone.types import HapticCommand, Prediction, Profile

CLICK_DURATION = 0.03
"""Seconds; a shorter burst is not felt as vibration (Sci. Rep. 2025, 15:5057)."""

CLICK_FREQUENCY = 250.0
"""Hz; where the skin is most sensitive (Verrillo 1963)."""

CLICKS = frozenset({"contact"})
"""Events that click: the onset, which is known within 5 ms. Whether it was a tap is known 25 ms later."""


class EventsProfile:
    """Adds a click to another profile at each onset of a touch.

    It remembers when the click began; each pipeline needs one of its own. Without an event detector in the pipeline it
    renders as the other profile does.
    """

    name = "events"

    def __init__(self, base: Profile) -> None:
        self._base = base
        self._clicked = -math.inf

    def command(self, prediction: Prediction) -> HapticCommand:
        """Return the vibration for a prediction; full amplitude for the length of a click."""
        if any(event.kind in CLICKS for event in prediction.events):
            self._clicked = prediction.end
        # Time may begin anew, where a stream is restarted.
        if 0 <= prediction.end - self._clicked < CLICK_DURATION and not prediction.faulty:
            return HapticCommand(1.0, CLICK_FREQUENCY, prediction.end)
        return self._base.command(prediction)
