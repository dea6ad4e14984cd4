"""Recipes that learn from features: tracks of features, training sets, classifiers and their ONNX graphs."""
