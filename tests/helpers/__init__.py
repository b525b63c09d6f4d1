"""What several tests use, imported as `from helpers import NAME`."""
