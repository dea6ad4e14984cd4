"""Training of detectors: recipes, features, the paper's network, fine-tuning, model files."""

import os

# OpenMP threads that spin while they wait slow each other down: a training step took ten times as long beside one busy
# process. OpenMP reads this when torch is first imported, which is after this line.
os.environ.setdefault("OMP_WAIT_POLICY", "passive")
