import threading

from tactophone.core.types import FloatArray
from tactophone.live.audio.actuator import ClockedDevice


def test_periods_come_at_the_pace_of_the_clock() -> None:
    enough = threading.Event()
    sizes: list[int] = []

    def process(_: list[FloatArray], outputs: list[FloatArray]) -> None:
        sizes.append(len(outputs[0]))
        if len(sizes) >= 20:
            enough.set()

    device = ClockedDevice(process, period=480)
    device.open()
    assert enough.wait(5.0)
    device.close()
    assert set(sizes) == {480}
    assert device.latency == 0.01
