from pathlib import Path

import pytest

from tactophone_lab.app.simulate import (
    RenderedSet,
    objects_named,
    plan_recordings,
    render_recordings,
)
from tactophone_lab.simulation.render import RenderJob, RenderOptions
from tactophone_lab.simulation.takes import takes_named


def test_an_interrupted_rendering_lists_what_is_finished(tmp_path: Path) -> None:
    options = RenderOptions(duration=0.5)
    plan = plan_recordings(objects_named("0,3"), takes_named("wiggle"), options)
    ends: list[RenderedSet] = []

    def interrupt(job: RenderJob) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        render_recordings(tmp_path, plan, finish=ends.append, report=interrupt)
    assert [(end.finished, end.planned) for end in ends] == [(1, 2)]
    assert len((tmp_path / "metadata.csv").read_text().splitlines()) == 2
    rendered = render_recordings(tmp_path, plan)
    assert (rendered.folder, rendered.finished) == (tmp_path, 2)
