"""All settings as frozen dataclasses, read from TOML and checked."""
