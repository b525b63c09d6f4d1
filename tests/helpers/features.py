"""The table of features of model files in docs/rendering.md, and what becomes of a file."""

from data_gen.mesh import UnusableModelError
from data_gen.readers.load import load_model
from helpers.commands import ROOT


def promised(file_format):
    """From the features of a format to "read", "warned" or "refused", as the table states."""
    text = (ROOT / "docs" / "rendering.md").read_text()
    table = text[text.index("\n| feature |") :].strip().partition("\n\n")[0]
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in table.splitlines()]
    column = rows[0].index(file_format)
    return {row[0]: row[column] for row in rows[2:] if row[column]}


def outcome(path):
    """What becomes of a file: "read", "warned" or "refused"."""
    try:
        return "warned" if load_model(path).warnings else "read"
    except UnusableModelError:
        return "refused"
