"""Networks, recipes, export: the only room that imports torch.

The walk: :mod:`~tactophone.training.sound` reads recordings as the live system hears them,
:mod:`~tactophone.training.network.windows` finds windows in them without copying any, :mod:`~tactophone.training.network.trainer`
learns, :mod:`~tactophone.training.model_export` writes the model file.
"""
