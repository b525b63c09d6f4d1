"""Warnings about missing or wrong contents of a file, and what is used instead."""


class Notes:
    """Warnings in order, without repetition."""

    def __init__(self) -> None:
        self.lines: list[str] = []

    def add(self, line: str) -> None:
        """Appends a warning."""
        line = line if len(line) <= 300 else line[:297] + "..."
        if line not in self.lines and len(self.lines) < 100:
            self.lines.append(line)
