"""What the processor computes quickly: bfloat16, or float32 alone."""

from pathlib import Path

from tactophone.training.network.settings import Precision

CPU_FLAGS = Path("/proc/cpuinfo")
"""Where Linux names the processor's instructions."""


def fastest_precision() -> Precision:
    """Return bfloat16 where the processor multiplies in it, otherwise float32, which is then many times faster."""
    flags = _flags()
    return "bfloat16" if "avx512_bf16" in flags or "amx_bf16" in flags else "float32"


def float32_products() -> str:
    """Return torch's precision of products (``torch.set_float32_matmul_precision``) that is fast and still float32.

    ``medium`` sends them to oneDNN, twice as fast as torch's default on AMD; on processors with AMX it would round
    their inputs to bfloat16.
    """
    return "highest" if "amx_bf16" in _flags() else "medium"


def _flags() -> str:
    try:
        return CPU_FLAGS.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""
