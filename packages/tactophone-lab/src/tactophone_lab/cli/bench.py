"""``tactophone bench``: test a finished finger with a ball, a pencil and a weight."""

import argparse

from tactophone.cli import console, options, output
from tactophone.cli.guide import GuideScreen, Steps, findings_in_words
from tactophone.cli.options import Within

EXAMPLES = (
    "tactophone bench --source jack",
    "tactophone bench --source finger",
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--yes", action="store_true", help="start each step without a key press"
    )
    parser.add_argument(
        "--weight",
        type=Within(float, 50, 200, unit="g"),
        default=100.0,
        metavar="G",
        help="mass of yoke and washers, as weighed, %(type)s",
    )
    parser.add_argument(
        "--pad",
        type=Within(float, 1, 10, unit="g"),
        default=4.4,
        metavar="G",
        help="mass of pad, ring and disc, as weighed, %(type)s; a printed ring: 1.6",
    )
    options.add_json(parser, "print the result as JSON")
    options.add_settings(parser, "setup")
    options.add_finger(parser)


def run(args: argparse.Namespace) -> int:
    from tactophone_lab.app.bench import run_bench

    settings = options.settings_of(args)
    with console.single_keys() as has_keyboard, output.live_display() as live:
        steps = Steps(GuideScreen(live, has_keyboard), unattended=args.yes)
        result = run_bench(
            settings,
            step=steps,
            begin=steps.begin,
            weight=1e-3 * args.weight,
            pad=1e-3 * args.pad,
        )
    rows = result.rows()
    values = {
        "passed": result.passed,
        "findings": [finding.message for finding in result.findings],
        **{row["test"]: row["measured"] for row in rows},
    }
    good = "good: the finger is built as expected"
    verdict = good if result.passed else "correct this, and test again"
    parts: list[output.Part] = [rows, *findings_in_words(result.findings), verdict]
    output.show(values, parts, as_json=args.json)
    return 0 if result.passed else 1
