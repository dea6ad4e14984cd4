"""Puts small faults into what keeps a promise of docs/reference/safety.md or
docs/reference/threat-model.md, runs the tests of its room on each, and prints the
faults that no test finds.

Each fault, a *mutant*, is tested in a process forked from one that has the libraries
already. The fault stands in memory there, and in a package of links for the processes
that the tests start; the files of the repository stay as they are. A mutant that
survives is a promise that no test holds, or an equivalent one: no input tells it from
the original.

    python scripts/mutants.py --files limits,gate --share 0.2 --seed 1
    python scripts/mutants.py --draw 50 --seed 20261128

`--draw` takes that number from all files together, the same ones for the same seed.
"""

import argparse
import ast
import contextlib
import importlib
import importlib.abc
import importlib.machinery
import importlib.util
import io
import os
import random
import signal
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import hypothesis
import pytest
from mutation import ALL_KINDS, Change, changes

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "packages/tactophone/src/tactophone"
TESTS = ROOT / "packages/tactophone/tests"


@dataclass(frozen=True)
class Target:
    """A file and the tests of its room, those that kill most first.

    - ``tests``: names in the room of the file, or paths from the folder of tests.
    - ``realtime``, ``slow``: whether tests that start real servers and threads are
      among them, and those that take long.
    """

    file: str
    tests: str
    realtime: bool = False
    slow: bool = False

    @property
    def path(self) -> Path:
        return PACKAGE / self.file

    @property
    def module(self) -> str:
        return ".".join(("tactophone", *Path(self.file).with_suffix("").parts))

    @property
    def paths(self) -> list[str]:
        """Paths of the file, for its examples, and of its tests."""
        room = TESTS / Path(self.file).parent
        tests = [
            TESTS / test if "/" in test else room / test for test in self.tests.split()
        ]
        return [str(self.path), *map(str, tests)]

    @property
    def marks(self) -> str:
        wanted = {"package": False, "realtime": self.realtime, "slow": self.slow}
        return " and ".join(f"not {mark}" for mark, runs in wanted.items() if not runs)

    def faults(self, kinds: Sequence[str]) -> list[Change]:
        tree = ast.parse(self.path.read_text("utf-8"))
        return [change for change in changes(tree) if change.kind in kinds]


TARGETS = {
    "limits": Target(
        "signal/haptics/limits.py", "test_limits.py test_mapping.py test_profiles.py"
    ),
    "oscillator": Target(
        "signal/haptics/oscillator.py",
        "test_oscillator.py test_playback.py test_waveform.py",
    ),
    "passthrough": Target(
        "signal/haptics/passthrough.py",
        "test_passthrough.py test_passthrough_renderer.py",
    ),
    "decision": Target(
        "signal/perception/decision.py", "test_decision.py test_engine.py"
    ),
    "fallback": Target(
        "signal/perception/fallback.py",
        "test_fallback.py test_faults.py test_following.py",
    ),
    "health": Target(
        "signal/perception/health.py",
        "test_faults.py test_signal_statistics.py test_invalid_samples.py",
    ),
    "contact": Target(
        "signal/perception/contact.py",
        "test_contact.py test_touch_detector.py test_motion.py test_airborne.py "
        "test_invalid_samples.py",
    ),
    "contact_state": Target(
        "signal/perception/contact_state.py",
        "test_contact_state.py test_touch_detector.py test_contact.py test_motion.py",
    ),
    "touch_state": Target("signal/perception/touch_state.py", "test_touch_detector.py"),
    "evidence": Target(
        "signal/perception/evidence.py", "test_evidence.py test_touch_detector.py"
    ),
    "detector": Target(
        "signal/perception/detector.py",
        "test_touch_detector.py test_detector.py test_batching.py "
        "test_invalid_samples.py test_no_touch.py",
    ),
    "window_detector": Target(
        "signal/perception/window_detector.py",
        "test_detector.py test_batching.py test_engine.py test_invalid_samples.py "
        "test_no_touch.py",
    ),
    "model_file": Target(
        "signal/perception/model_file.py",
        "test_model_file.py test_model_checks.py test_model_trial.py",
    ),
    "onnx_table": Target(
        "signal/perception/onnx_table.py", "test_model_checks.py test_model_trial.py"
    ),
    "noise_floor": Target(
        "signal/perception/noise_floor.py",
        "test_noise_floor.py test_recording_floor.py test_following.py",
    ),
    "calibration": Target(
        "signal/perception/calibration.py",
        "test_calibration_file.py test_calibration_measurement.py",
    ),
    "airborne": Target(
        "signal/perception/airborne.py", "test_airborne.py test_contact.py"
    ),
    "no_touch": Target("signal/perception/no_touch.py", "test_no_touch.py"),
    "fit": Target("signal/perception/fit.py", "test_fit.py test_detector.py"),
    "resample": Target(
        "signal/perception/resample.py",
        "test_resample.py test_windows.py test_detector.py",
    ),
    "levels": Target(
        "signal/perception/levels.py",
        "test_loudness.py test_contact.py test_airborne.py",
    ),
    "models": Target(
        "signal/perception/models.py",
        "core/test_tips.py test_detector.py test_touch_detector.py test_engine.py "
        "test_airborne.py",
    ),
    "opening": Target(
        "signal/perception/opening.py",
        "app/test_doors.py app/test_tables.py app/test_open_input.py "
        "test_touch_detector.py",
    ),
    "watchdog": Target("live/runtime/watchdog.py", "test_watchdog.py"),
    "gate": Target(
        "live/runtime/output_gate.py",
        "test_output_gate.py test_finger_output.py",
    ),
    "operator": Target(
        "live/runtime/operator.py",
        "test_operator.py test_hand.py test_network.py",
        realtime=True,
    ),
    "jack": Target(
        "live/audio/jack.py", "test_jack.py test_actuator.py", realtime=True
    ),
    "device": Target(
        "live/audio/device.py", "test_stream.py test_actuator.py", realtime=True
    ),
    "gamepad": Target("live/audio/gamepad.py", "test_gamepad.py"),
    "memory": Target(
        "live/telemetry/memory.py", "test_memory.py test_writer.py test_watcher.py"
    ),
    "log": Target("live/log/mcap.py", "test_mcap.py test_hand_log.py"),
    "session": Target(
        "net/link/session.py",
        "test_session_bounds.py test_session.py test_renewal.py "
        "test_hostile_callers.py test_session_states.py test_end_to_end.py",
    ),
    "handshake": Target(
        "net/link/handshake.py",
        "test_handshake.py test_hostile_callers.py test_session.py "
        "test_session_bounds.py",
    ),
    "identity": Target("net/link/identity.py", "test_identity.py"),
    "packet": Target(
        "net/link/packet.py",
        "test_packet.py test_packetizer.py test_depacketizer.py test_session.py",
    ),
    "rtcp": Target("net/link/rtcp.py", "test_rtcp.py test_send.py test_session.py"),
    "send": Target("net/link/send.py", "test_send.py test_end_to_end.py"),
    "playout": Target("net/link/playout.py", "test_playout.py test_playout_clock.py"),
    "stream": Target(
        "net/link/stream.py",
        "test_packetizer.py test_depacketizer.py test_send.py test_end_to_end.py",
    ),
    "receive": Target(
        "net/link/receive.py",
        "test_end_to_end.py test_prediction_payload.py net/test_endpoints.py",
    ),
    "endpoints": Target("net/endpoints.py", "test_endpoints.py"),
    "messages": Target("net/call/messages.py", "test_messages.py test_guard.py"),
    "guard": Target("net/call/guard.py", "test_guard.py test_allowed.py"),
    "ice": Target("net/call/ice.py", "test_allowed.py test_given_up.py"),
    "exchange": Target(
        "net/call/exchange.py",
        "test_mailbox.py test_hostile_mailbox.py test_nobody.py",
        slow=True,
    ),
    "passage": Target("net/call/passage.py", "test_call_socket.py"),
    "security": Target("faces/web/security.py", "test_security.py test_requests.py"),
    "connections": Target("faces/web/connections.py", "test_places.py test_guards.py"),
    "processes": Target("core/processes.py", "test_processes.py", slow=True),
}


class _Loader(importlib.machinery.SourceFileLoader):
    """Imports one module from a changed tree."""

    def __init__(self, name: str, path: str, tree: ast.Module) -> None:
        super().__init__(name, path)
        self._tree = tree

    def get_code(self, fullname: str) -> Any:
        return compile(ast.fix_missing_locations(self._tree), self.path, "exec")


class _Finder(importlib.abc.MetaPathFinder):
    def __init__(self, loader: _Loader) -> None:
        self._loader = loader

    def find_spec(self, fullname: str, path: Any, target: Any = None) -> Any:
        if fullname == self._loader.name:
            return importlib.util.spec_from_file_location(
                fullname, self._loader.path, loader=self._loader
            )
        return None


class Overlay:
    """The package as links to its files, one of them replaced: what a new process
    imports."""

    def __init__(self, folder: Path) -> None:
        self._package = folder / PACKAGE.name
        self._written = 0
        for path in sorted(PACKAGE.rglob("*")):
            if "__pycache__" in path.parts:
                continue
            link = self._package / path.relative_to(PACKAGE)
            if path.is_dir():
                link.mkdir(parents=True)
            else:
                link.parent.mkdir(parents=True, exist_ok=True)
                link.symlink_to(path)
        # A process takes the first folder that has the package; one that is spawned
        # gets the path of this one.
        sys.path.insert(0, str(folder))
        before = os.environ.get("PYTHONPATH", "")
        os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, [str(folder), before]))

    @contextlib.contextmanager
    def replacing(self, target: Target, tree: ast.Module) -> Iterator[None]:
        path = self._package / target.file
        path.unlink()
        path.write_text(ast.unparse(tree), encoding="utf-8")
        # Python tells a changed file by its size and the second of its change.
        self._written += 1
        os.utime(path, (self._written, self._written))
        try:
            yield
        finally:
            path.unlink()
            path.symlink_to(target.path)


def survives(target: Target, tree: ast.Module, overlay: Overlay, limit: float) -> bool:
    """Whether all tests pass on a mutant, in a process of its own that ends after
    ``limit`` seconds."""
    with overlay.replacing(target, tree):
        return _passes(target, tree, limit)


def _passes(target: Target, tree: ast.Module, limit: float) -> bool:
    if child := os.fork():
        return os.waitpid(child, 0)[1] == 0
    # A group of its own, so that what the tests start ends with it.
    os.setpgid(0, 0)
    signal.signal(signal.SIGALRM, lambda *_: os.killpg(0, signal.SIGKILL))
    signal.alarm(max(1, round(limit)))
    nothing = os.open(os.devnull, os.O_RDWR)
    for stream in range(3):
        os.dup2(nothing, stream)
    try:
        sys.meta_path.insert(0, _Finder(_Loader(target.module, str(target.path), tree)))
        importlib.import_module(target.module)
        failed = int(
            pytest.main(
                ["-x", "-m", target.marks, "-p", "no:rerunfailures", *target.paths]
            )
        )
    except BaseException:
        failed = 1
    os._exit(failed)


def limit_of(target: Target, overlay: Overlay) -> float:
    """Return how long (s) a mutant's tests may take: four times as long as the same
    tests take on the original, where they have to pass."""
    begin = time.monotonic()
    tree = ast.parse(target.path.read_text("utf-8"))
    if not survives(target, tree, overlay, 600):
        sys.exit(
            f"{target.file}: its tests fail already; run pytest "
            f"-m '{target.marks}' {' '.join(target.paths)}"
        )
    return 5 + 4 * (time.monotonic() - begin)


def run(target: Target, chosen: Sequence[Change], overlay: Overlay) -> int:
    """Test some faults of one file; print the survivors, and return their number."""
    limit = limit_of(target, overlay)
    tree = ast.parse(target.path.read_text("utf-8"))
    # A fault belongs to the tree that it was found in.
    same = {str(change): change for change in changes(tree)}
    alive = 0
    for change in chosen:
        mutant = same[str(change)].made_in(tree)
        if survives(target, mutant, overlay, limit):
            alive += 1
            print(f"{target.file}:{change}", flush=True)
    killed = len(chosen) - alive
    print(
        f"{target.file}: {len(chosen)} mutants, {killed} killed, {alive} survived",
        flush=True,
    )
    return alive


def choose(
    names: Sequence[str], kinds: Sequence[str], options: argparse.Namespace
) -> dict[str, list[Change]]:
    """Return the faults to test, by the name of their file."""
    rng = random.Random(options.seed)
    faults = {name: TARGETS[name].faults(kinds) for name in names}
    if options.draw:
        # First a file, then a fault of it, or the longest files would have most.
        chosen: dict[str, list[Change]] = {}
        for _ in range(options.draw):
            name = rng.choice(names)
            if faults[name]:
                place = rng.randrange(len(faults[name]))
                chosen.setdefault(name, []).append(faults[name].pop(place))
        return chosen
    if options.share < 1:
        return {
            name: rng.sample(found, max(1, round(options.share * len(found))))
            for name, found in faults.items()
        }
    return faults


def main() -> None:
    parser = argparse.ArgumentParser(
        description=str(__doc__).split("\n\n", maxsplit=1)[0]
    )
    parser.add_argument(
        "--files", default=",".join(TARGETS), help="names, with commas between them"
    )
    parser.add_argument(
        "--kinds",
        default=",".join(ALL_KINDS),
        help="kinds of faults, with commas between them; all by default",
    )
    parser.add_argument(
        "--share",
        type=float,
        default=1.0,
        help="of each file's mutants, chosen at random",
    )
    parser.add_argument("--draw", type=int, default=0, help="mutants of all files")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--list", action="store_true", help="print them, test none")
    options = parser.parse_args()
    names, kinds = options.files.split(","), options.kinds.split(",")
    for given, known in ((names, TARGETS), (kinds, ALL_KINDS)):
        if unknown := sorted(set(given) - set(known)):
            parser.error(
                f"there is no {', '.join(unknown)}; there are {', '.join(known)}"
            )
    os.chdir(ROOT)
    chosen = choose(names, kinds, options)
    if options.list:
        for name, found in chosen.items():
            for change in found:
                print(f"{TARGETS[name].file}:{change}")
        return
    load_libraries(list(chosen))
    with tempfile.TemporaryDirectory() as folder:
        overlay = Overlay(Path(folder))
        alive = sum(
            run(TARGETS[name], found, overlay) for name, found in chosen.items()
        )
    total = sum(map(len, chosen.values()))
    print(f"{total} mutants, {alive} survived", flush=True)


def load_libraries(names: Sequence[str]) -> None:
    """Import what the tests need, so that no mutant waits for libraries; our own
    modules are then imported anew for each."""
    os.environ["HYPOTHESIS_PROFILE"] = "few"
    hypothesis.settings.register_profile(
        "few", max_examples=20, derandomize=True, deadline=None
    )
    with contextlib.redirect_stdout(io.StringIO()):
        tests = [path for name in names for path in TARGETS[name].paths]
        pytest.main(["--collect-only", *tests])
    ours = [
        module
        for module in sys.modules
        if module.split(".")[0] in ("tactophone", "tests", "benchmarks")
    ]
    for module in ours:
        del sys.modules[module]


if __name__ == "__main__":
    main()
