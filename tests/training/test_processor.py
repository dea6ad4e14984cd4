"""What the processor computes quickly, by its flags."""

from pathlib import Path

import pytest

from tactophone.training import trainer as processor


@pytest.mark.parametrize(
    ("flags", "fastest", "float32"),
    [
        ("sse2 avx2", "float32", "medium"),
        ("avx512_bf16", "bfloat16", "medium"),
        ("avx512_bf16 amx_bf16", "bfloat16", "highest"),
    ],
)
def test_float32_is_never_rounded(
    flags: str, fastest: str, float32: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "cpuinfo").write_text(f"flags\t\t: fpu {flags} lm\n")
    monkeypatch.setattr(processor, "CPU_FLAGS", tmp_path / "cpuinfo")
    assert processor.fastest_precision() == fastest
    assert processor.float32_products() == float32


def test_a_system_without_flags_is_taken_for_a_simple_one(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(processor, "CPU_FLAGS", tmp_path / "missing")
    assert processor.fastest_precision() == "float32"
