"""How loud a sound in the room is at both microphones, if nothing else is said."""

BARE_DISC_DB = 20.0
"""dB by which the contact microphone hears the air's sound fainter if its disc is bare,
at its resonance: the most that is assumed. Under a pad it is derived to be 67 dB."""

VOICE_DBFS = -20.0
"""Level of the loudest second at the air microphone: speech beside the finger, with the
microphone's gain of the shipped models' training sound."""
