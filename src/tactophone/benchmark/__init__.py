"""Every method on the same splits, behind one protocol; the paper's tables and the report.

What needs the training room (torch, onnx, scikit-learn) or the simulator is in modules of its own: import those.
"""

from tactophone.benchmark.folds import Cache, Method, cross_validate, default_cache, permute_labels, run_folds

__all__ = ["Cache", "Method", "cross_validate", "default_cache", "permute_labels", "run_folds"]
