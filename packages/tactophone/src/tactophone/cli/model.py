"""``tactophone model``: the card of a model file."""

import argparse
import json
from collections.abc import Mapping
from typing import Any

from tactophone.cli import options, output
from tactophone.signal.perception.model_file import ModelCard, read_model
from tactophone.signal.perception.models import model_path, shipped_models

EXAMPLES = (
    "tactophone model show texture",
    "tactophone model show finger.onnx --json",
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_action = options.add_actions(parser)
    show = add_action(
        "show",
        "show a model's card: input, decision rule, training data, scores",
        _show,
    )
    words = f"a model file, or one that ships: {', '.join(shipped_models()) or 'none'}"
    show.add_argument("model", metavar="NAME|FILE", help=words)
    options.add_json(show, "print the card as JSON")


def _show(args: argparse.Namespace) -> int:
    path = model_path(args.model)
    card = read_model(path).card
    size = path.stat().st_size
    rows = [("file", f"{path} ({size / 1e3:,.0f} kB)"), *_lines(card)]
    listing = output.listing(((name, words) for name, words in rows), max_width=36)
    values = {"file": str(path), "bytes": size, **json.loads(card.to_json())}
    output.show(values, [listing], as_json=args.json)
    return 0


def _lines(card: ModelCard) -> list[tuple[str, str]]:
    duration = card.duration
    hop = float(card.hop) / card.sample_rate
    gate = card.gate
    rule = card.decision
    lines = [
        ("model", f"{card.name}, of kind {card.kind}"),
        (
            "input",
            f"{card.channels} channel{'s' * (card.channels > 1)} at {card.sample_rate} "
            "Hz",
        ),
        (
            "window",
            f"{card.window_size} samples, {1000 * duration:.1f} ms; one every "
            f"{1000 * hop:.2f} ms",
        ),
        (
            "delay",
            f"of {card.name}: a change fills its window after {1000 * duration:.0f} ms",
        ),
        (
            "contact",
            f"from {gate.threshold_dbfs:.1f} dBFS, {gate.rule.replace('_', ' ')}, over "
            "the window",
        ),
        (
            "rough",
            f"by the evidence of a touch; even odds at P(rough) {rule.even_share:.2g}",
        ),
        (
            "single windows",
            f"rough from {rule.rough_on:g}, until under {rule.rough_off:g}, after "
            f"{rule.confirm} in a row",
        ),
    ]
    known = {name: getattr(card, name) for name in ("settings", "training", "scores")}
    lines += [*_outline(known), ("licence", card.licence or "not stated")]
    return [(name, _shortened(text)) for name, text in lines[:MOST_LINES]]


MOST_LINES = 200
"""Lines shown of a card; the shipped ones have some sixty."""

LONGEST_TEXT = 2_000
"""Characters shown of one entry; the longest licence of a shipped model has 900."""


def _shortened(text: str) -> str:
    if len(text) <= LONGEST_TEXT:
        return text
    return f"{text[:LONGEST_TEXT]}... ({len(text)} characters; --json shows all)"


def _outline(entries: Mapping[str, Any], indent: str = "") -> list[tuple[str, str]]:
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
        case [float(), float(), float(), float(), *_]:
            return f"{len(value)} numbers"
        case [*words]:
            return "; ".join(map(str, words))
        case float():
            return f"{value:.4g}"
    return str(value)


def _shape(value: Any) -> list[int]:
    """Count the entries of nested lists, level by level."""
    if not isinstance(value, list):
        return []
    return [len(value), *(_shape(value[0]) if value else [])]
