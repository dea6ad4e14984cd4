"""Which optional dependency a missing module belongs to, and the command that installs
it."""

import importlib.util
import sys
from collections.abc import Iterable, Mapping

from tactophone.core.errors import ConfigError
from tactophone.core.foreign_settings import SETTINGS, refuse_settings_here

_MODULES = {
    "plot": ("matplotlib",),
    "link": ("pylibsrtp", "OpenSSL", "opuslib_next", "samplerate"),
    "call": ("aioice", "wormhole"),
    "jack": ("jack",),
    "portaudio": ("sounddevice",),
    "dashboard": ("aiohttp", "segno"),
    "gamepad": ("evdev",),
    "record": ("mcap", "zstandard"),
    "osc": ("pythonosc",),
    "ros": ("cyclonedds", "rosbags"),
    "zenoh": ("zenoh",),
}
"""Extras of the package ``tactophone``."""

_LAB_MODULES = {
    "heights": ("PIL",),
    "sim": ("numba", "scipy"),
    "train": ("torch", "onnx", "sklearn"),
    "ray": ("ray",),
}
"""Extras of the package ``tactophone-lab``."""


def _requirements(
    package: str, table: Mapping[str, tuple[str, ...]]
) -> dict[str, tuple[str, str]]:
    return {
        module: (package, extra)
        for extra, modules in table.items()
        for module in modules
    }


REQUIREMENT_OF_MODULE = {
    **_requirements("tactophone", _MODULES),
    **_requirements("tactophone-lab", _LAB_MODULES),
}
"""Import name of each optional dependency -> the package and its extra that install
it."""

INSTALL_LABORATORY = "in the clone, pip install './packages/tactophone-lab[sim]'"
"""The command that installs the laboratory: neither package is on an index yet, so pip
finds by name only what is installed."""

WITHOUT_WHEEL = {"cyclonedds": (3, 14)}
"""Modules with no wheel from that Python on: their extra leaves them out there."""


def require_extras(*extras: str) -> None:
    """Check that everything in these extras is installed; see `require_modules`."""
    known = _MODULES | _LAB_MODULES
    require_modules(*(module for extra in extras for module in known[extra]))


def require_modules(*modules: str) -> None:
    """Check that the modules that an option needs are installed, and that the current
    folder holds no settings for them.

    Raises `ConfigError` if one is missing, and names the command that installs it; or
    if there are such settings.
    """
    missing = [module for module in modules if importlib.util.find_spec(module) is None]
    if missing:
        raise ConfigError(_advice(missing))
    for module in SETTINGS.keys() & set(modules):
        refuse_settings_here(module)


def explain(error: ModuleNotFoundError) -> str:
    """Return one line that says which module is missing and how to install it.

    Raises the same error if no extra has the module: then it is a mistake in the code.

    >>> explain(ModuleNotFoundError(name="pylibsrtp.policy"))
    "pylibsrtp is not installed: pip install 'tactophone[link]'"
    """
    module = (error.name or "").partition(".")[0]
    if module not in REQUIREMENT_OF_MODULE:
        raise error
    return _advice([module])


def _advice(modules: list[str]) -> str:
    for module in modules:
        without_wheel = module in WITHOUT_WHEEL
        if without_wheel and sys.version_info >= WITHOUT_WHEEL[module]:
            found = ".".join(map(str, sys.version_info[:2]))
            return f"{module} has no wheel for Python {found}: use Python 3.11 to 3.13"
    verb = "is" if len(modules) == 1 else "are"
    return f"{', '.join(modules)} {verb} not installed: pip install {_wanted(modules)}"


def _wanted(modules: Iterable[str]) -> str:
    """Return the requirements that bring these modules, one for each package."""
    extras: dict[str, set[str]] = {}
    for module in modules:
        package, extra = REQUIREMENT_OF_MODULE[module]
        extras.setdefault(package, set()).add(extra)
    return " ".join(
        f"'{package}[{','.join(sorted(names))}]'"
        for package, names in sorted(extras.items())
    )
