"""The verbs of the laboratory; the entry point ``tactophone.verbs`` adds them to the
command ``tactophone``."""

from tactophone.cli.verbs import Verb

VERBS = (
    Verb(
        "demo",
        "tactophone_lab.cli.demo",
        "start",
        "stroke a smooth and a rough stone with no hardware: picture, sound, numbers",
        ("link", "plot", "sim"),
        newcomer=True,
    ),
    Verb(
        "play",
        "tactophone_lab.cli.play",
        "start",
        "the stone box in a browser: find the rough ones of five hidden stones by "
        "touch alone",
        ("dashboard", "link", "sim"),
        newcomer=True,
    ),
    Verb(
        "latency",
        "tactophone_lab.cli.latency",
        "run",
        "measure the latency from microphone to vibration with impulses, stage by "
        "stage",
        ("jack", "link", "sim"),
    ),
    Verb(
        "setup",
        "tactophone_lab.cli.setup",
        "finger",
        "fit a detector to a new finger in two minutes, or compare two objects",
        newcomer=True,
    ),
    Verb(
        "record",
        "tactophone_lab.cli.record",
        "finger",
        "record an object by the paper's protocol: seven guided takes, each checked "
        "and saved at once",
    ),
    Verb(
        "bench",
        "tactophone_lab.cli.bench",
        "finger",
        "test a finished finger with a ball, a pencil and a weight",
        special=True,
    ),
    Verb(
        "fetch",
        "tactophone_lab.cli.fetch",
        "sound",
        "download the recordings of the paper's authors, or convert another published "
        "set",
        special=True,
    ),
    Verb(
        "dataset",
        "tactophone_lab.cli.dataset",
        "sound",
        "show what a data set holds, and check it for broken, silent, clipped or "
        "wrongly labelled files",
    ),
    Verb(
        "simulate",
        "tactophone_lab.cli.simulate",
        "sound",
        "render sound with the simulated finger: the paper's data set, competition "
        "runs, the catalogue",
        ("sim",),
    ),
    Verb(
        "roughness",
        "tactophone_lab.cli.roughness",
        "sound",
        "measure Ra, Rq, Rz, RSm, Sa and more of a height profile or height map",
        special=True,
    ),
    Verb(
        "train",
        "tactophone_lab.cli.train",
        "model",
        "train a detector on labelled recordings; resumes after an interruption",
        ("train",),
    ),
    Verb(
        "finetune",
        "tactophone_lab.cli.finetune",
        "model",
        "adapt a model to new objects, and show what it costs on the old ones",
        ("train",),
        special=True,
    ),
    Verb(
        "set-threshold",
        "tactophone_lab.cli.set_threshold",
        "model",
        "choose thresholds and hysteresis for a rate of false bumps, and write them "
        "into the model",
    ),
    Verb(
        "import-model",
        "tactophone_lab.cli.import_model",
        "model",
        "convert a model that the paper's authors published, or that their notebook "
        "saved",
        ("train",),
        special=True,
    ),
    Verb(
        "evaluate",
        "tactophone_lab.cli.evaluate",
        "lab",
        "score a model, or cross-validate a recipe: beside baselines, or with --vary "
        "under many settings",
    ),
    Verb(
        "benchmark",
        "tactophone_lab.cli.benchmark",
        "lab",
        "compare every method on the same splits: a table, a JSON file, a page with "
        "figures",
        ("link", "plot", "sim", "train"),
    ),
)
"""In the order of the help."""
