import inspect
import subprocess
import sys
from pathlib import Path

import pytest

import tactophone


@pytest.mark.parametrize("name", tactophone.__all__)
def test_every_public_name_can_be_imported(name: str) -> None:
    assert getattr(tactophone, name) is not None


@pytest.mark.parametrize("name", tactophone.__all__)
def test_every_public_class_and_function_has_a_docstring(name: str) -> None:
    value = getattr(tactophone, name)
    if not (
        inspect.isclass(value) or inspect.isfunction(value)
    ) or value.__module__.startswith("numpy"):
        return
    assert value.__doc__
    for method, member in vars(value).items() if inspect.isclass(value) else ():
        if not method.startswith("_") and (
            inspect.isfunction(member) or isinstance(member, property)
        ):
            assert member.__doc__, f"{name}.{method}"


def test_the_api_page_lists_every_public_name_and_begins_with_the_pipeline() -> None:
    page = (Path(__file__).parent.parent / "docs/reference/api.md").read_text()
    listed = [
        line.removeprefix("::: tactophone.")
        for line in page.splitlines()
        if line.startswith("::: ")
    ]
    assert listed[0] == "open_pipeline"
    assert sorted([*listed, "__version__"]) == sorted(tactophone.__all__)


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="telegraph"):
        _ = tactophone.telegraph


def test_importing_the_package_loads_no_model_runtime_and_no_network_library() -> None:
    heavy = ("onnxruntime", "OpenSSL", "pylibsrtp", "soundfile", "rich")
    code = (
        "import sys, tactophone; "
        f"print([name for name in {heavy} if name in sys.modules])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "[]"


def test_the_package_is_typed() -> None:
    assert (Path(tactophone.__file__).parent / "py.typed").is_file()
