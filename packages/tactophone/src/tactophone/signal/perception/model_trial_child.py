"""What the child of `model_trial` runs: it loads and tries a model under limits."""

import json
import os
import sys
from pathlib import Path

from tactophone.core.errors import ModelError
from tactophone.signal.perception.model_file import probe_model
from tactophone.signal.perception.model_trial import (
    TRIAL_MEMORY,
    limit_this_process,
)


def main() -> None:
    """Try the model at standard input; the last line printed is why it is refused, or
    an empty text."""
    import onnxruntime  # noqa: F401  # before the limits, which count from here

    content = sys.stdin.buffer.read()
    limit_this_process()
    refusal = ""
    try:
        probe_model(Path(sys.argv[1]), content)
    except ModelError as error:
        refusal = str(error)
    except MemoryError:
        refusal = (
            f"{sys.argv[1]}: takes over {TRIAL_MEMORY / 1e9:g} GB of memory; "
            "export it again"
        )
    sys.stdout.write("\n" + json.dumps(refusal))
    sys.stdout.flush()
    # A thread that still computes would end Python with a message of its own.
    os._exit(0)


if __name__ == "__main__":
    main()
