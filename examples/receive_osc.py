"""Print what a run sends as OSC: `tactophone loopback --bridge osc=127.0.0.1:9000`,
then `receive_osc.py 9000`."""

import sys
import time

from pythonosc.dispatcher import Dispatcher
from pythonosc.osc_server import ThreadingOSCUDPServer

port = int(sys.argv[1])
seconds = float(sys.argv[2]) if len(sys.argv) > 2 else 10.0
dispatcher = Dispatcher()
dispatcher.map(
    "/tactophone/*",
    lambda address, *values: print(address, *(f"{value:.2f}" for value in values)),
)
with ThreadingOSCUDPServer(("127.0.0.1", port), dispatcher) as server:
    server.timeout = 0.1
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        server.handle_request()
