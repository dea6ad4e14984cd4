"""The paper's network: settings, training loop, export and import."""
