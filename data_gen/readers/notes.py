"""What was missing or wrong in a file and what stands in for it."""


class Notes:
    """Warnings in order, each once."""

    def __init__(self) -> None:
        self.lines: list[str] = []

    def add(self, line: str) -> None:
        """Appends a warning."""
        line = line if len(line) <= 300 else line[:297] + "..."
        if line not in self.lines and len(self.lines) < 100:
            self.lines.append(line)
