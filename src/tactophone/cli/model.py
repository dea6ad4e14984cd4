"""``tactophone model``: show a model file's card, or convert one of the authors' published models."""

import argparse
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rich.markup import escape
from rich.table import Table

from tactophone.cli._support import terminal
from tactophone.perception import ModelCard, model_path, read_model, shipped_models


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's actions and their arguments."""
    actions = parser.add_subparsers(title="actions", metavar="ACTION", required=True)
    words = "show a model's card: input, decision rule, training data, scores"
    show = actions.add_parser("show", help=words, description=words)
    show.set_defaults(run=_show)
    show.add_argument(
        "model", metavar="NAME|FILE", help=f"a model file, or one that ships: {', '.join(shipped_models()) or 'none'}"
    )
    show.add_argument("--json", action="store_true", help="print the card as JSON")
    words = (
        "convert a model that the paper's authors published (general.pt, fine_tuned.pt, piezo_only.pt) or that their "
        "notebook saved (model.pt, with its threshold; model_script.pt); a TorchScript file is a program that torch "
        "runs while loading: import it only from a source you trust"
    )
    published = actions.add_parser("import", help=words, description=words)
    published.set_defaults(run=_import)
    published.add_argument("source", type=Path, metavar="FILE.pt", help="the TorchScript file, or model.pt")
    published.add_argument(
        "--out", type=Path, metavar="FILE", help="the model file to write (default: FILE.onnx, in this folder)"
    )


def _import(args: argparse.Namespace) -> int:
    from tactophone.training import import_published

    out = args.out or Path(args.source.stem + ".onnx")
    import_published(args.source, out)
    print(out)
    return 0


def _show(args: argparse.Namespace) -> int:
    path = model_path(args.model)
    card = read_model(path).card
    if args.json:
        terminal.print_json({"file": str(path), "bytes": path.stat().st_size, **json.loads(card.to_json())})
        return 0
    table = Table.grid(padding=(0, 2))
    table.add_column(style="dim", max_width=36, overflow="fold")
    table.add_column(overflow="fold")
    table.add_row("file", escape(f"{path} ({path.stat().st_size / 1e3:,.0f} kB)"))
    for name, words in _lines(card):
        table.add_row(name, escape(words))
    terminal.out().print(table)
    return 0


def _lines(card: ModelCard) -> list[tuple[str, str]]:
    duration, hop = card.window_size / card.sample_rate, float(card.hop) / card.sample_rate
    gate, rule = card.gate, card.decision
    lines = [
        ("model", f"{card.name}, of kind {card.kind}"),
        ("input", f"{card.channels} channel{'s' * (card.channels > 1)} at {card.sample_rate} Hz"),
        ("window", f"{card.window_size} samples, {1000 * duration:.1f} ms; one every {1000 * hop:.2f} ms"),
        ("delay", f"of {card.name}: a change fills its window after {1000 * duration:.0f} ms; {_confirming(card)}"),
        ("contact", f"from {gate.threshold_dbfs:.1f} dBFS, {gate.rule.replace('_', ' ')}, over the window"),
        ("rough", f"from {rule.rough_on:g}, until under {rule.rough_off:g}, after {rule.confirm} in a row"),
    ]
    known = {name: getattr(card, name) for name in ("settings", "training", "scores")}
    return [*lines, *_outline(known), ("licence", card.licence or "not stated")]


def _confirming(card: ModelCard) -> str:
    """Say how long the decision rule waits besides."""
    waits = 1000 * (card.decision.confirm - 1) * float(card.hop) / card.sample_rate
    return f"rough is confirmed {waits:.0f} ms later" if waits else "no confirmation"


def _outline(entries: Mapping[str, Any], indent: str = "") -> list[tuple[str, str]]:
    """List nested entries under headings."""
    lines = []
    for key, value in entries.items():
        if not isinstance(value, Mapping):
            lines.append((indent + key, _words(value)))
        elif value:
            lines += [(indent + key, ""), *_outline(value, indent + "  ")]
    return lines


def _words(value: Any) -> str:
    match value:
        case [float(score), float(low), float(high)] if low <= score <= high:
            return f"{score:.3f} ({low:.3f} to {high:.3f})"
        case [[*_], *_]:
            return f"{' x '.join(map(str, _shape(value)))} numbers"
        case [*words]:
            return "; ".join(map(str, words))
        case float():
            return f"{value:.4g}"
    return str(value)


def _shape(value: Any) -> list[int]:
    """Count the entries of nested lists, level by level."""
    return [len(value), *_shape(value[0])] if isinstance(value, list) else []
