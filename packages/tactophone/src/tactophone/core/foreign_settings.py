"""Settings of libraries that lie in the current folder, which somebody may have
downloaded.

A folder of data must not be a folder of code. Two libraries look for their settings in
the current folder, and what they find there can run code: numba loads machine code, by
pickle, from whatever folder its settings name, and matplotlib starts LaTeX or, before
3.11, evaluates an expression. Neither has a switch for that.
"""

import os
import sys

from tactophone.core.errors import ConfigError

SETTINGS = {"matplotlib": "matplotlibrc", "numba": ".numba_config.yaml"}
"""Name of the file by the library that reads it while it is imported."""


def refuse_settings_here(library: str) -> None:
    """Check, before a library of `SETTINGS` is imported, that the current folder holds
    no settings for it.

    Raises `ConfigError` if it does. Where the library is imported already, the program
    around this package has decided that.
    """
    name = SETTINGS[library]
    if library not in sys.modules and os.path.lexists(name):
        raise ConfigError(
            f"the current folder holds {name}: {library} would take settings from it, "
            "which can run code; run the command in another folder, or rename the file"
        )
