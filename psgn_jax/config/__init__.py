"""The configuration: dataclasses, parsing, named files."""

from psgn_jax.config.experiment import Config, ConfigError, parse, to_dict

__all__ = ["Config", "ConfigError", "parse", "to_dict"]
