"""What the workflows of CI name is there: files, targets of make, permissions."""

import re
import subprocess
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parent.parent
yaml = pytest.importorskip("yaml")

WORKFLOWS = {
    path.stem: yaml.safe_load(path.read_text("utf-8"))
    for path in sorted((ROOT / ".github" / "workflows").glob("*.yml"))
}
FOLDERS = r"(?:\.ci|benchmarks|integrations|packages|requirements|scripts|tests)/"


JOBS = [
    pytest.param(job | {"workflow": workflow}, id=f"{name}-{key}")
    for name, workflow in WORKFLOWS.items()
    for key, job in workflow["jobs"].items()
]


@pytest.mark.parametrize("job", JOBS)
def test_every_command_is_one_of_the_shell_and_names_what_is_there(
    job: dict[str, Any],
) -> None:
    makefile = (ROOT / "Makefile").read_text("utf-8")
    for command in (step["run"] for step in job["steps"] if "run" in step):
        words = re.sub(r"\$\{\{.*?\}\}", "x", command)
        subprocess.run(["bash", "-n", "-c", words], check=True)
        for path in re.findall(rf"(?<![\w./-]){FOLDERS}[\w./-]*\w", command):
            assert (ROOT / path).exists(), command
        for target in re.findall(r"\bmake ([a-z]+)", command):
            assert re.search(rf"^{target}:", makefile, re.MULTILINE), command


@pytest.mark.parametrize("job", JOBS)
def test_a_job_that_checks_out_the_repository_may_read_it(job: dict[str, Any]) -> None:
    """Permissions of a job take the place of the workflow's."""
    uses = [step.get("uses", "") for step in job["steps"]]
    if any(each.startswith("actions/checkout@") for each in uses):
        permissions = job.get("permissions", job["workflow"]["permissions"])
        assert permissions.get("contents") == "read"
