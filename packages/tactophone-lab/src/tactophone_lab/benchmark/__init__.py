"""Every method on the same splits, behind one protocol; the paper's tables and the
report."""
