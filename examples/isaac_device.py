"""Render a pulse of NVIDIA Isaac Teleop with our oscillator, under its limits: ``python isaac_device.py pulse.wav``."""

import sys

import numpy as np
import soundfile
from isaacteleop.retargeting_engine.deviceio_source_nodes import HapticSink

from tactophone import Limits, Oscillator
from tactophone.bridges.isaac import TactophoneDevice

oscillator = Oscillator(Limits(ceiling=0.3))
device = TactophoneDevice(oscillator.submit, endpoint="right")
sink = HapticSink("fingertip", device)  # connect this in an Isaac graph; here the pulse is applied by hand
vibration = np.zeros((20, 480), np.float32)
for step, wave in enumerate(vibration):
    if step < 10:  # a controller's pulse: amplitude, frequency in Hz, duration in s
        sink.device.apply("right", np.array([1.0, 120.0, 0.02]))
    sink.flush_to_device(None)
    oscillator.render(wave)
soundfile.write(sys.argv[1], vibration.ravel(), 48_000)
print(f"peak {abs(vibration).max():.2f} of full drive")
