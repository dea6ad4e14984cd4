"""``tactophone import-model``: the paper authors' models as model files of ours."""

import argparse
from pathlib import Path

from tactophone.core.errors import ConfigError
from tactophone.core.processes import is_same_file

EXAMPLES = (
    "tactophone import-model general.pt",
    "tactophone import-model model.pt --out notebook.onnx",
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "source",
        type=Path,
        metavar="FILE",
        help="what the authors published (general.pt, fine_tuned.pt, piezo_only.pt) or "
        "their notebook saved (model.pt, with its threshold; model_script.pt); "
        "only numbers and text are read, and no code in it runs",
    )
    parser.add_argument(
        "--out",
        type=Path,
        metavar="FILE",
        help="the model file to write (default: FILE.onnx, in this folder)",
    )


def run(args: argparse.Namespace) -> int:
    from tactophone_lab.training.published_models import import_published

    out = args.out or Path(args.source.stem + ".onnx")
    if is_same_file(out, args.source):
        raise ConfigError(f"--out {out}: the file that is read; name another file")
    import_published(args.source, out)
    print(out)
    return 0
