"""Dependencies that report to their makers, switched off before they are imported.

A telephone for touch runs beside patients, prototypes and people at home. Whoever
installs it agreed to nothing that its libraries send. Each of these libraries has a
switch in the environment that it reads only once, while it is imported or started, so
`switch_off` runs before anything else of this package does. Child processes inherit the
environment.
"""

import os
from collections.abc import Mapping, MutableMapping

SWITCHES: Mapping[str, str] = {
    "ORT_DISABLE_TELEMETRY": "1",
    "RAY_USAGE_STATS_ENABLED": "0",
    "HF_HUB_DISABLE_TELEMETRY": "1",
}
"""Environment variables, and the values that switch statistics off.

ONNX Runtime, from 1.31 on Linux too, looks up a host of its maker and keeps an
identifier of the machine and a queue of events in the user's cache. Its function
``disable_telemetry_events`` comes too late: both files are written by the import. Ray
reports the size and the kind of a cluster, and Hugging Face's client the libraries that
call it.
"""


def switch_off(environment: MutableMapping[str, str] = os.environ) -> None:
    """Switch off the statistics of all dependencies, except where the user has set
    their switch."""
    for name, value in SWITCHES.items():
        environment.setdefault(name, value)
