"""Helpers that several tests use, imported as `from helpers import NAME`."""
