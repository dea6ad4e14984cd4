"""Recipes: every named way to train a detector.

`train`, `evaluate`, `benchmark` and the Makefile read :data:`RECIPES`; nothing else
lists them. Reading it imports neither torch nor scikit-learn. A recipe with its
options, :class:`ConfiguredRecipe`, can train; a recipe file (:class:`RecipeFile`) names
both. CONTRIBUTING.md says how to add a detector.
"""

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, TypeAlias

import msgspec

from tactophone.core.errors import ConfigError, did_you_mean
from tactophone.core.small_files import read_small
from tactophone.signal.perception.calibration import Calibration
from tactophone.signal.perception.decision import DecisionRule
from tactophone_lab.training.augmentation import Augmentation
from tactophone_lab.training.recipe_options import Recipe, Response, TrainingOptions

if TYPE_CHECKING:
    from tactophone_lab.training.baselines import FeatureRecipe
    from tactophone_lab.training.trainer import NetworkRecipe

ConfiguredRecipe: TypeAlias = "FeatureRecipe | NetworkRecipe"
"""A recipe with its options: everything that decides a training but the recordings, and
``train``, which does it."""

_CONFIRMED = Response(
    DecisionRule(rough_on=0.6, rough_off=0.4, confirm=4, abstain_from=0.5),
    memory=0.25,
    change_detection=False,
)
"""*None* where sound is unknown, and rough must hold for 40 ms: that halves the false
bumps of a prediction that moves quickly. Statistics that restart cost 0.02 of accuracy
on real kinds left out. The hysteresis lies evenly around a half: it ends the false
bumps of sound at the boundary, for 0.003 of what is rendered right there
(docs/research/detector.md)."""

_OF_PAD = Response(
    DecisionRule(rough_on=0.8, rough_off=0.5, confirm=3, abstain_from=0.5), memory=0.12
)
"""Under the pad a stroke that turns every 0.2 s moves the probability, as its level
swings by 20 dB: so rough begins at 0.8, held for 30 ms, as few smooth windows do. A
longer memory scores no better there and reports edges later. Under a stylus, of real
kinds left out, such a memory and 0.8 already cost 0.09 of what is rendered right
(docs/research/detector.md)."""

_LISTED = (
    Recipe(
        "paper",
        "the paper's network and figures: spectral magnitudes of 256 ms into a "
        "residual MLP",
        "magnitudes",
        version=1,
        shipped=True,
    ),
    Recipe(
        "paper-fast",
        "the same network, in smaller batches and at least 500 of them",
        "magnitudes",
        version=1,
    ),
    Recipe(
        "texture",
        "short windows, running statistics of the touch, a calibrated linear "
        "classifier",
        "texture",
        response=_CONFIRMED,
        pad_response=_OF_PAD,
        version=10,
        augmentation=Augmentation(),
        shipped=True,
    ),
    Recipe("level", "loudness against a threshold", "cues"),
    Recipe("rules", "five cues vote: level, crest, transients, centroid, air", "cues"),
    Recipe("median-frequency", "frequency with half the power on either side", "cues"),
)

RECIPES: Mapping[str, Recipe] = MappingProxyType(
    {recipe.name: recipe for recipe in _LISTED}
)
"""Every recipe by name."""

FEATURE_RECIPES = tuple(
    name for name, recipe in RECIPES.items() if recipe.features != "magnitudes"
)
"""Names of the recipes that learn from features: all but the paper's network."""


def configure(
    name: str,
    options: TrainingOptions | None = None,
    *,
    start: Path | None = None,
    calibration: Calibration | None = None,
) -> ConfiguredRecipe:
    """Return the recipe of a name with its options, ready to train; imports what it
    needs.

    ``start`` is a model file to continue from, and ``calibration`` replaces the contact
    threshold; both for the paper's network alone.
    """
    recipe = RECIPES[name]
    options = options or TrainingOptions()
    if recipe.features == "magnitudes":
        from tactophone_lab.training.trainer import network_recipe

        return network_recipe(recipe, options, start=start, calibration=calibration)
    from tactophone_lab.training.baselines import feature_recipe

    return feature_recipe(recipe, options)


LARGEST_RECIPE = 1 << 14
"""Bytes of a recipe file; one that names every option takes under 1,000."""


class RecipeFile(TrainingOptions, frozen=True, kw_only=True):
    """What a recipe file may hold: the name of a recipe, and the options that differ
    from its defaults."""

    recipe: str = "texture"

    @classmethod
    def read(cls, path: Path) -> "RecipeFile":
        """Read a TOML file; raises `ConfigError` as `changed` does, or if it cannot be
        read."""
        try:
            entries = msgspec.toml.decode(read_small(path, LARGEST_RECIPE))
        except (OSError, ValueError, RecursionError) as error:
            raise ConfigError(f"{path}: {error}; {cls._help()}") from None
        return cls().changed(entries, where=str(path))

    def changed(self, entries: Mapping[str, Any], *, where: str) -> "RecipeFile":
        """Return the recipe with other entries; a number or a switch may be given as
        text.

        Raises `ConfigError`, which begins with ``where``, for an unknown recipe or key,
        or a value out of range.
        """
        try:
            changed = msgspec.convert(
                {**msgspec.structs.asdict(self), **entries}, RecipeFile, strict=False
            )
        except msgspec.ValidationError as error:
            hints = (
                did_you_mean(name, self.__struct_fields__)
                for name in entries
                if not hasattr(self, name)
            )
            raise ConfigError(
                f"{where}: {error}{next(hints, '')}; {self._help()}"
            ) from None
        if changed.recipe not in RECIPES:
            hint = did_you_mean(changed.recipe, RECIPES)
            raise ConfigError(
                f"{where}: no recipe {changed.recipe}; there are "
                f"{', '.join(RECIPES)}{hint}"
            )
        return changed

    @classmethod
    def _help(cls) -> str:
        return f"a recipe file is TOML and may hold {', '.join(cls.__struct_fields__)}"

    def configured(
        self, *, start: Path | None = None, calibration: Calibration | None = None
    ) -> ConfiguredRecipe:
        """Return the recipe, which can train; ``start`` and ``calibration`` as in
        :func:`configure`."""
        return configure(self.recipe, self, start=start, calibration=calibration)
