"""From a configuration to a trained network in a folder."""
