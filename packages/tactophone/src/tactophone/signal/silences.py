"""How long a touch may be silent: all that ends after a silence, and when.

A finger on a surface is not always heard. It stands still where a stroke turns: for
29 ms in the median of simulated strokes, for 71 ms in one of ten, and for a quarter of
a second at most. It is off the surface between two strokes, for up to a second. While
it is silent, nobody knows which of these it is. So what was said of a touch ends in
steps, and what costs most if it is wrong ends first:

============== ===================================================================
silent for     what ends
============== ===================================================================
`PAUSE`        rough, where the sound broke off: from here on the touch is smooth
`FADED_PAUSE`  rough, where the sound faded out first, as it does before a turn
`TOUCH_HOLD`   contact: from here on nothing is felt
`SLIDE_HOLD`   sliding, among touch events: the finger has lifted off
`LONGEST_TURN` the grade by which a touch is drawn; without a contact gate, rough too
`LIFT`         the evidence of whether it is rough: the next touch begins as smooth
============== ===================================================================

Silence is the finger's. Sound that the network or a device has lost is another thing
(`signal.perception.detector.LONGEST_GAP`).
"""

PAUSE = 0.01
"""Seconds that rough is felt over an abrupt silence. With the bands' windows of 64 ms,
rough ends at most about 75 ms after its sound."""

FADED_PAUSE = 0.08
"""Seconds that rough is felt over a silence after a fade-out: longer than nine of ten
turns."""

TOUCH_HOLD = 0.1
"""Seconds that contact is held over a silence. A longer hold bridges more turns, and is
felt for longer after the finger has lifted."""

SLIDE_HOLD = 0.12
"""Seconds that sliding is held before it is a *lift-off*. An event that was reported
cannot be taken back, so it waits a little longer than contact does."""

LONGEST_TURN = 0.25
"""Seconds that a finger stands still where a stroke turns, at most: a longer silence
was a lift. After one the grade of a touch is averaged anew: the next may be on another
thing, and unlike the evidence an average does not outweigh what it remembers."""

LIFT = 1.0
"""Seconds without a window that is heard after which the evidence begins anew: fingers
that stroke lift for up to a second, and take longer to reach another thing. Until then
the new windows outweigh what they contradict, within 80 ms where they are usual."""
