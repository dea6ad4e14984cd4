import pytest

from tactophone.app.sources import for_one_microphone
from tactophone.core.settings import Settings, change


@pytest.mark.parametrize(
    ("chosen", "model", "tip"),
    [
        (["capture.source=browser"], "stylus", "stylus"),
        (["capture.source=browser", "capture.tip=rubber"], "stylus", "rubber"),
        (["capture.source=microphone", "detector.model=texture"], "texture", "pad"),
        (["capture.source=jack"], "", "pad"),
    ],
)
def test_one_air_microphone_has_the_model_for_it_and_that_models_tip(
    chosen: list[str], model: str, tip: str
) -> None:
    settings = for_one_microphone(change(Settings(), chosen))
    assert (settings.detector.model, settings.capture.tip) == (model, tip)
