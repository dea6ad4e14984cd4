"""The paper's network: recipe, training loop, export and import."""
